//! Several players on several variants of the traffic, as text: a line per player and a column per variant.

use super::comparison::{blocks, cell, difference, wide_title};
use super::{Finding, figures};
use dials_core::base::statistics::Interval;

/// Returns a table of each of these figures, and one of the differences from the first player. `findings`: `[variants, players]`;
/// `labels`: one per variant. A figure that the players do not have is left out.
pub fn of_variants(labels: &[String], findings: &[Vec<Finding>], shown: &[&str]) -> String {
    let first = &findings[0];
    let players: Vec<String> = first.iter().map(|finding| finding.player.label.clone()).collect();
    let names: Vec<&str> = labels.iter().map(String::as_str).collect();
    let values = |variant: usize, player: usize, figure: &str| -> Option<Vec<f64>> {
        let figures = figures(&findings[variant][player].episodes);
        figures.into_iter().find(|(name, _)| name == figure).map(|(_, values)| values)
    };
    let mut parts = vec![wide_title(first)];
    for figure in shown {
        let of_player = |player: usize| -> Option<Vec<Vec<f64>>> {
            (0..labels.len()).map(|variant| values(variant, player, figure)).collect()
        };
        let Some(all) = (0..players.len()).map(of_player).collect::<Option<Vec<_>>>() else { continue };
        let means: Vec<Vec<String>> =
            all.iter().map(|variants| variants.iter().map(|values| cell(Interval::of(values))).collect()).collect();
        parts.push(format!("{figure}\n{}", blocks(&names, &players, &means)));
        if players.len() < 2 {
            continue;
        }
        let of_others = |variants: &Vec<Vec<f64>>| -> Vec<String> {
            variants.iter().zip(&all[0]).map(|(values, reference)| difference(values, reference)).collect()
        };
        let differences: Vec<Vec<String>> = all[1..].iter().map(of_others).collect();
        parts.push(format!(
            "{figure}: difference from {} (paired by episode)\n{}",
            players[0],
            blocks(&names, &players[1..], &differences)
        ));
    }
    parts.join("\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{EpisodeReport, Player};
    use dials_core::domain::Measures;

    #[test]
    fn each_variant_is_a_column_and_differences_are_paired() {
        let finding = |label: &str, delays: [f64; 2]| Finding {
            player: Player { label: label.into(), keys: Vec::new(), policies: None, others: None },
            episodes: delays
                .map(|delay| EpisodeReport {
                    returns: vec![0.0],
                    measures: Measures { system: vec![("delay_s".into(), delay)], ..Measures::default() },
                })
                .to_vec(),
        };
        // 8 - 20 = -12 and 9 - 21 = -12: -12. With more demand 30 - 40 = -10 and 34 - 40 = -6: -8.
        let findings = vec![
            vec![finding("program", [20.0, 21.0]), finding("a", [8.0, 9.0])],
            vec![finding("program", [40.0, 40.0]), finding("a", [30.0, 34.0])],
        ];
        let labels = ["demand 1", "demand 1.2"].map(str::to_owned);
        let text = of_variants(&labels, &findings, &["delay_s", "unknown"]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 10, "{text}");
        assert!(lines[3].contains("demand 1") && lines[3].contains("demand 1.2"), "{text}");
        assert_eq!(lines[7], "delay_s: difference from program (paired by episode)");
        assert!(lines[9].starts_with("a") && lines[9].contains("-12") && lines[9].contains("-8"), "{text}");
        assert!(!text.contains("unknown"), "{text}");
    }
}
