//! Keys that older configs have in another place. These configs can still be read.

use anyhow::{Result, ensure};
use toml::{Table, Value};

/// Key of `[policy]` in older configs, now a key of `[traffic]`.
const SWITCH_BIAS: &str = "initial_switch_bias";

/// Moves the values of older places to the current ones, and overwrites what is there. Returns whether anything was
/// moved.
pub(super) fn rename(config: &mut Table) -> Result<bool> {
    let Some(Value::Table(policy)) = config.get_mut("policy") else { return Ok(false) };
    let Some(bias) = policy.remove(SWITCH_BIAS) else { return Ok(false) };
    let is_zero = bias.as_float() == Some(0.0) || bias.as_integer() == Some(0);
    match config.get_mut("traffic") {
        Some(Value::Table(traffic)) => drop(traffic.insert(SWITCH_BIAS.to_owned(), bias)),
        // Older runs wrote the key for every domain.
        _ => ensure!(is_zero, "policy.{SWITCH_BIAS} = {bias}: is a key of [traffic], but there is no such table"),
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn renamed(text: &str) -> String {
        let mut config: Table = toml::from_str(text).unwrap();
        rename(&mut config).map_or_else(|error| error.to_string(), |_| config.to_string())
    }

    #[test]
    fn the_switch_bias_of_an_older_config_is_a_key_of_traffic() {
        let found = renamed("[policy]\nsequence_length = 4\ninitial_switch_bias = -1.5\n[traffic]\nhorizon = 10");
        assert_eq!(found, "[policy]\nsequence_length = 4\n\n[traffic]\nhorizon = 10\ninitial_switch_bias = -1.5\n");
        assert_eq!(renamed("[policy]\ninitial_switch_bias = 0.0\n[warehouse]"), "[policy]\n\n[warehouse]\n");
        let error = renamed("[policy]\ninitial_switch_bias = -1.5\n[warehouse]");
        assert_eq!(error, "policy.initial_switch_bias = -1.5: is a key of [traffic], but there is no such table");
    }
}
