//! The worst lights, as text for a terminal.

use super::{DELAY, Part, Played, QUEUE, STOPS, level_of_service, title};
use dials_core::base::statistics::Interval;
use dials_core::base::{TERMINAL_COLUMNS, counted, wrapped};

/// Number of lights that are shown.
const WORST: usize = 10;

/// Returns a table of the lights where the first player's cars lose the most time, with a block per light: a line per player. `labels`:
/// what the players are called, the reference first.
pub fn table(players: &[Played<'_>], labels: &[String]) -> String {
    let [reference, ..] = players else { return String::new() };
    let order = reference.worst_first();
    let shown = order.len().min(WORST);
    let all = match order.len() {
        count if count > shown => {
            format!("the {shown} of {count} lights where cars lose the most time under {}", labels[0])
        }
        count => format!("{}, those where cars lose the most time under {} first", counted(count, "light"), labels[0]),
    };
    let about = format!("{all}; all, with approaches and movements: --json, or --csv DIR");
    let mut lines = wrapped(&about, TERMINAL_COLUMNS);
    let width = labels.iter().map(|label| label.chars().count()).max().unwrap_or(0).min(28);
    let compares = players.len() > 1;
    let difference = if compares { format!("{:>16}", "difference") } else { String::new() };
    lines.push(format!("  {:<width$}  cars{:>14} LOS  stops  queue{difference}", "", "delay s/car"));
    for &light in &order[..shown] {
        lines.extend(names(&reference.places[light].id, &title(&reference.places[light])));
        let first = reference.figures(Part::Light(light));
        for (number, (player, label)) in players.iter().zip(labels).enumerate() {
            let own = player.figures(Part::Light(light));
            let (own_line, label) =
                if label.chars().count() > width { (Some(format!("  {label}")), "") } else { (None, &**label) };
            let delay = own.mean(DELAY);
            let level = delay.map_or('-', |delay| level_of_service(delay.mean));
            let mean = |name| own.mean(name).map_or("-".to_owned(), |found: Interval| format!("{:.1}", found.mean));
            let stops = own.mean(STOPS).map_or("-".to_owned(), |found| format!("{:.2}", found.mean));
            let difference = match own.difference(&first, DELAY) {
                Some(found) if number > 0 => format!("{:>16}", signed(found)),
                _ => String::new(),
            };
            lines.extend(own_line);
            lines.push(format!(
                "  {label:<width$} {:>5.0}{:>14}   {level} {stops:>6} {:>6}{difference}",
                own.cars,
                delay.map_or("-".to_owned(), plain),
                mean(QUEUE),
            ));
        }
    }
    let about = "LOS: level of service by the delay (HCM: A to 10, B to 20, C to 35, D to 55, E to 80 s, then F). queue: standing cars \
                 on the worst approach, exceeded in 5 % of the seconds.";
    lines.extend(wrapped(about, TERMINAL_COLUMNS));
    lines.join("\n")
}

/// Returns the line of a light: its streets and its id, which is never cut.
fn names(id: &str, title: &str) -> Vec<String> {
    match title == id {
        true => vec![id.to_owned()],
        false => wrapped(&format!("{title} ({id})"), TERMINAL_COLUMNS),
    }
}

fn plain(interval: Interval) -> String {
    match interval.half_width {
        None | Some(0.0) => format!("{:.1}", interval.mean),
        Some(half_width) => format!("{:.1} +- {half_width:.1}", interval.mean),
    }
}

fn signed(interval: Interval) -> String {
    let text = plain(interval);
    if text.starts_with('-') { text } else { format!("+{text}") }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{episode, light};
    use super::*;

    #[test]
    fn the_worst_ten_are_shown_with_their_differences_and_no_id_is_cut() {
        let long = format!("cluster_{}", "123456789_".repeat(12));
        let mut places: Vec<_> = (0..11).map(|number| light(&format!("L{number}"), &[])).collect();
        places.push(light(&long, &["High Street", "Mill Lane"]));
        let at = |delay_s: f64| episode(&(0..12).map(|light| (10, delay_s * f64::from(light))).collect::<Vec<_>>());
        let (before, after) = ([at(100.0), at(120.0)], [at(50.0), at(60.0)]);
        let players = [&before, &after].map(|episodes| Played { places: &places, episodes });
        let text = table(&players, &["program".to_owned(), "max-pressure".to_owned()]);
        assert!(
            text.starts_with("the 10 of 12 lights where cars lose the most time under program; all, with"),
            "{text}"
        );
        assert!(text.contains(&long) && text.contains("High Street / Mill Lane"), "{text}");
        assert!(!text.contains("\nL1\n") && text.contains("\nL2\n"), "{text}");
        // Light 11: 110 and 132 s before, 55 and 66 after: the difference is -60.5 +- 12.706 * 5.5.
        assert!(text.contains("-60.5 +- 69.9"), "{text}");
        let narrow = text.lines().filter(|line| !line.contains(&long));
        assert!(narrow.clone().all(|line| line.chars().count() <= TERMINAL_COLUMNS), "{text}");
    }
}
