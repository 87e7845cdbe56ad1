//! What becomes of every option of SUMO that a .sumocfg can set.
//!
//! An option that changes traffic is carried over or refused, never dropped in silence. The rest is left out: this
//! program seeds, measures and writes by itself.
//!
//! Source: `sumo --help` of SUMO 1.15.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// Carried over: SUMO gets it in every simulation, and so does the copy in a run directory.
    Carried,
    /// Left out. The user gets the reason.
    LeftOut(&'static str),
    /// Left out in silence: it changes no traffic here and writes nothing of use.
    Silent,
    Refused(&'static str),
}

use Fate::{Carried, LeftOut, Refused, Silent};

const REMOVES: &str = "cars that SUMO takes off the road would count as cars that arrived";

/// Names of options by their fate. A `*` stands for any text. If several fit, the longest counts.
const OPTIONS: &[(Fate, &str)] = &[
    // Input and processing.
    (
        Refused("it reads a file that this program does not copy into a run directory"),
        "load-state weight-files astar.*",
    ),
    (Silent, "load-state.* weight-attribute threads"),
    (Carried, "junction-taz step-method.ballistic extrapolate-departpos route-steps scale scale-suffix"),
    (Carried, "ignore-junction-blocker ignore-route-errors ignore-accidents collision.* max-num-vehicles"),
    (Carried, "time-to-teleport time-to-teleport.* waiting-time-memory startup-wait-threshold time-to-impatience"),
    (Carried, "max-depart-delay sloppy-insert eager-insert emergency-insert random-depart-offset"),
    (Carried, "lanechange.overtake-right tls.* default.* routing-algorithm weights.*"),
    (Silent, "time-to-teleport.ride tls.actuated.show-detectors emergencydecel.warning-threshold"),
    (LeftOut("an episode ends at its end only"), "max-num-teleports"),
    (Refused("this program does not know the sublane model, in which cars share a lane"), "lateral-resolution"),
    (Refused("without internal lanes cars jump over intersections"), "no-internal-links"),
    (Refused("this program cannot replay a car between two lanes"), "lanechange.duration"),
    (Refused("the agents run the lights"), "tls.all-off"),
    (Refused("routes of another run cannot be replayed here"), "replay-rerouting"),
    (Refused("this program simulates single cars and lanes"), "mesosim"),
    (Silent, "meso-*"),
    // What there is only with stops, persons and trains, which are refused where they stand.
    (Silent, "parking.maneuver use-stop-ended pedestrian.* ride.* persontrip.* person-device.*"),
    (Silent, "railway.* railsignal-moving-block overhead-wire.*"),
    // Devices that change how cars drive, and others that only measure.
    (Carried, "device.rerouting.*"),
    (
        Refused("cars with this device drive in a way that this program cannot replay"),
        "device.toc.* device.driverstate.* device.bluelight.* device.taxi.* device.glosa.*",
    ),
    (Silent, "device.* device.rerouting.threads emissions.* phemlight-*"),
    // Output and reports.
    (
        LeftOut("this program writes its own measurements"),
        "*-output device.rerouting.output netstate-dump save-state.* log message-log error-log",
    ),
    (Silent, "*-output.* netstate-dump.* output-prefix precision precision.geo human-readable-time write-license"),
    (Silent, "verbose print-options xml-validation xml-validation.* no-warnings aggregate-warnings"),
    (Silent, "duration-log.* no-step-log step-log.period"),
    // TraCI, random numbers, the window.
    (LeftOut("this program runs SUMO by itself"), "remote-port num-clients"),
    (LeftOut("this program seeds every episode by itself"), "random seed thread-rngs"),
    (Silent, "gui-* g quit-on-end game game.mode start delay breakpoints edgedata-files demo disable-textures"),
    (Silent, "registry-viewport window-size window-pos tracker-interval osg-view"),
];

/// Whole names of options, and their short and older ones.
const OTHER_NAMES: [(&str, &str); 12] = [
    ("net-file", "n net"),
    ("route-files", "r routes"),
    ("additional-files", "a additional"),
    ("begin", "b"),
    ("end", "e"),
    ("verbose", "v"),
    ("no-warnings", "W"),
    ("log", "l log-file"),
    ("route-steps", "s"),
    ("seed", "srand"),
    ("summary-output", "summary"),
    ("tripinfo-output", "tripinfo"),
];

pub(super) fn whole_name(name: &str) -> &str {
    let is_other = |others: &str| others.split(' ').any(|other| other == name);
    OTHER_NAMES.iter().find(|(_, others)| is_other(others)).map_or(name, |(whole, _)| whole)
}

/// Returns what becomes of an option, or `None` if SUMO has none of this name. What is off is never refused.
pub(super) fn fate_of(name: &str, value: &str) -> Option<Fate> {
    let patterns = OPTIONS.iter().flat_map(|(fate, names)| names.split(' ').map(move |pattern| (pattern, *fate)));
    let (_, fate) = patterns.filter(|(pattern, _)| fits(name, pattern)).max_by_key(|(pattern, _)| pattern.len())?;
    match name {
        "collision.action" if value == "remove" => Some(Refused(REMOVES)),
        "time-to-teleport.remove" if !is_off(value) => Some(Refused(REMOVES)),
        // Below 0, SUMO's default, cars wait until there is room.
        "max-depart-delay" if !value.starts_with('-') => {
            Some(Refused("cars that SUMO no longer lets wait would be missing from all figures"))
        }
        _ if is_off(value) && matches!(fate, LeftOut(_) | Refused(_)) => Some(Silent),
        _ => Some(fate),
    }
}

/// Returns why a parameter such as `has.glosa.device` is refused: it gives a vehicle a device that is refused, too.
pub(crate) fn refused_parameter(key: &str, value: &str) -> Option<&'static str> {
    let key = key.to_ascii_lowercase();
    let device = key.strip_prefix("has.").and_then(|rest| rest.strip_suffix(".device"));
    let option = device.map_or(key.clone(), |device| format!("device.{device}.probability"));
    match fate_of(&option, value) {
        Some(Refused(why)) if option.starts_with("device.") => Some(why),
        _ => None,
    }
}

/// Returns whether a name fits a pattern, in which a `*` at the beginning or the end stands for any text.
fn fits(name: &str, pattern: &str) -> bool {
    match (pattern.strip_prefix('*'), pattern.strip_suffix('*')) {
        (Some(rest), None) => name.ends_with(rest),
        (None, Some(rest)) => name.starts_with(rest),
        (Some(_), Some(_)) => name.contains(pattern.trim_matches('*')),
        (None, None) => name == pattern,
    }
}

fn is_off(value: &str) -> bool {
    let no = ["false", "no", "off", "f", "-", ""].contains(&value.to_ascii_lowercase().as_str());
    no || value.parse::<f64>().is_ok_and(|number| number <= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_pattern_that_fits_decides() {
        assert_eq!(fate_of("time-to-teleport.ride", "1"), Some(Silent));
        assert_eq!(fate_of("time-to-teleport.highways", "1"), Some(Carried));
        assert!(matches!(fate_of("fcd-output", "a"), Some(LeftOut(_))));
        assert_eq!(fate_of("fcd-output.geo", "1"), Some(Silent));
        assert_eq!(fate_of("device.ssm.probability", "1"), Some(Silent));
        assert!(matches!(fate_of("device.toc.probability", "1"), Some(Refused(_))));
        assert_eq!(fate_of("no-such-option", "1"), None);
        assert_eq!((whole_name("b"), whole_name("begin")), ("begin", "begin"));
    }

    #[test]
    fn options_by_which_cars_vanish_are_refused_with_some_values_only() {
        for (name, refused, carried) in [
            ("time-to-teleport.remove", "true", "false"),
            ("collision.action", "remove", "teleport"),
            ("max-depart-delay", "0", "-1"),
        ] {
            assert!(matches!(fate_of(name, refused), Some(Refused(_))), "{name}");
            assert_eq!(fate_of(name, carried), Some(Carried), "{name}");
        }
    }

    #[test]
    fn a_vehicle_gets_no_device_that_is_refused_as_an_option() {
        for (key, value, is_refused) in [
            ("has.GLOSA.device", "1", true),
            ("has.glosa.device", "false", false),
            ("device.driverstate.initialAwareness", "0.5", true),
            ("has.rerouting.device", "true", false),
            ("lcStrategic", "1", false),
        ] {
            assert_eq!(refused_parameter(key, value).is_some(), is_refused, "{key} = {value}");
        }
    }
}
