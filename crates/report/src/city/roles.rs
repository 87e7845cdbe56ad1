//! Who is who in a comparison: today's plan, a plan to put back, rules, and policies.

use super::read::{City, CityPlayer};
use dials_core::domain::light_figures::TODAYS_PLAN;

/// The controller that runs the lights' own programs.
pub(super) const TODAY: &str = "program";

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Role {
    Today,
    /// A plan that `plan` wrote.
    Plan,
    Learned,
    Rule,
}

impl Role {
    pub(super) fn of(player: &CityPlayer) -> Role {
        match player {
            CityPlayer { plan: true, .. } => Role::Plan,
            CityPlayer { learned: true, .. } => Role::Learned,
            _ if player.label == TODAY => Role::Today,
            _ => Role::Rule,
        }
    }
}

/// Returns the player that is shown against the first one: the best plan, for that is taken home, or else the best learned one,
/// or else the best of the others.
pub(super) fn best(city: &City) -> Option<&CityPlayer> {
    let others = || city.players.iter().skip(1);
    let of_role = |role: Role| others().filter(move |player| Role::of(player) == role);
    least_delay(of_role(Role::Plan)).or_else(|| least_delay(of_role(Role::Learned))).or_else(|| least_delay(others()))
}

/// Returns the players of a role and the one of least delay among them.
pub(super) fn all_and_best(city: &City, role: Role) -> (usize, Option<&CityPlayer>) {
    let of_role = || city.players.iter().filter(move |player| Role::of(player) == role);
    (of_role().count(), least_delay(of_role()))
}

fn least_delay<'a>(players: impl Iterator<Item = &'a CityPlayer>) -> Option<&'a CityPlayer> {
    let delay = |player: &CityPlayer| player.delay_s().map_or(f64::INFINITY, |found| found.mean);
    players.min_by(|one, other| delay(one).total_cmp(&delay(other)))
}

/// Returns the name of a player within a sentence. A plan's label is `plan of X`.
pub(super) fn name_of(player: &CityPlayer) -> String {
    match (&*player.label, Role::of(player)) {
        (TODAY, _) => TODAYS_PLAN.to_owned(),
        (label, Role::Plan) => format!("the {label}"),
        (label, _) => label.to_owned(),
    }
}

/// Returns the name of a player behind its role. Only one of several is called the best.
pub(super) fn role(city: &City, player: &CityPlayer) -> String {
    let own = Role::of(player);
    let (count, best) = all_and_best(city, own);
    let is_best = best.is_some_and(|best| best.label == player.label);
    let role = match own {
        Role::Plan => return player.label.clone(),
        Role::Today => return TODAYS_PLAN.to_owned(),
        Role::Learned if count == 1 => "learned",
        Role::Rule if count == 1 => "rule",
        Role::Learned if is_best => "best learned",
        Role::Rule if is_best => "best rule",
        Role::Learned | Role::Rule => return player.label.clone(),
    };
    format!("{role}: {}", player.label)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn city(players: &[(&str, bool, bool, f64)]) -> City {
        let players: Vec<_> = players
            .iter()
            .map(|(label, learned, plan, delay_s)| {
                json!({ "label": label, "learned": learned, "plan": plan, "figures": { "delay_s": { "mean": delay_s } },
                        "lights": [] })
            })
            .collect();
        let city = json!({ "seed": 0, "episodes": 1, "left_out": [], "warnings": [], "settings": {}, "streets": [],
                           "players": players });
        serde_json::from_value(city).unwrap()
    }

    fn roles(city: &City) -> Vec<String> {
        city.players.iter().map(|player| role(city, player)).collect()
    }

    #[test]
    fn a_rule_without_a_rival_is_not_the_best() {
        let one = city(&[("program", false, false, 40.0), ("webster", false, false, 30.0)]);
        assert_eq!(roles(&one), ["today's plan", "rule: webster"]);
        // The first one takes part in the choice, too.
        let two = city(&[("max-pressure", false, false, 20.0), ("webster", false, false, 30.0)]);
        assert_eq!(roles(&two), ["best rule: max-pressure", "webster"]);
    }

    #[test]
    fn a_plan_is_shown_before_what_was_learned_and_what_was_learned_before_rules() {
        let mut all = vec![
            ("program", false, false, 40.0),
            ("max-pressure", false, false, 20.0),
            ("runs/a", true, false, 25.0),
            ("plan of webster", false, true, 30.0),
        ];
        for expected in ["plan of webster", "runs/a", "max-pressure"] {
            assert_eq!(best(&city(&all)).unwrap().label, expected);
            all.pop();
        }
        assert!(best(&city(&all)).is_none());
    }
}
