//! What becomes of every option of SUMO that a .sumocfg can set.
//!
//! An option that changes traffic is carried over or refused, never dropped in silence. The rest is left out: this
//! program seeds, measures and writes by itself.
//!
//! Source: `sumo --help` of SUMO 1.15.

/// What becomes of an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// Carried over: SUMO gets it in every simulation, and so does the copy in a run directory.
    Carried,
    /// Carried over, but some values are refused with the reason.
    CarriedUnless(Values, &'static str),
    /// Left out. The user gets the reason.
    LeftOut(&'static str),
    /// Left out in silence: it changes no traffic here and writes nothing of use.
    Silent,
    /// Refused with the reason, unless it has the value that switches it off.
    Refused(&'static str),
}

/// Some of the values that an option may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Values {
    /// Those that switch it on.
    On,
    Word(&'static str),
    NotNegative,
}

impl Values {
    /// Returns whether a value is among them.
    pub(super) fn has(self, value: &str) -> bool {
        match self {
            Values::On => !is_off(value),
            Values::Word(word) => value == word,
            Values::NotNegative => !value.starts_with('-'),
        }
    }
}

use Fate::{Carried, CarriedUnless, LeftOut, Refused, Silent};

const WRITES: &str = "this program writes its own measurements";
const SEEDS: &str = "this program seeds every episode by itself";
const TRACI: &str = "this program runs SUMO by itself";
const DEVICE: &str = "cars with this device drive in a way that this program cannot replay";
const READS: &str = "it reads a file that this program does not copy into a run directory";
const MESO: &str = "this program simulates single cars and lanes";
const REMOVES: &str = "cars that SUMO takes off the road would count as cars that arrived";
const DROPS: &str = "cars that SUMO no longer lets wait would be missing from all figures";

/// Options by name, or by the beginning of it where a `*` ends the name. The first that fits counts.
const OPTIONS: &[(&str, Fate)] = &[
    // Input.
    ("load-state", Refused(READS)),
    ("load-state.*", Silent),
    ("weight-files", Refused(READS)),
    ("weight-attribute", Silent),
    ("junction-taz", Carried),
    // Output.
    ("write-license", Silent),
    ("output-prefix", Silent),
    ("precision", Silent),
    ("precision.geo", Silent),
    ("human-readable-time", Silent),
    ("netstate-dump", LeftOut(WRITES)),
    ("netstate-dump.*", Silent),
    ("save-state.*", LeftOut(WRITES)),
    ("*-output", LeftOut(WRITES)),
    ("*-output.*", Silent),
    // Processing.
    ("step-method.ballistic", Carried),
    ("extrapolate-departpos", Carried),
    ("threads", Silent),
    ("lateral-resolution", Refused("this program does not know the sublane model, in which cars share a lane")),
    ("route-steps", Carried),
    ("no-internal-links", Refused("without internal lanes cars jump over intersections")),
    ("ignore-junction-blocker", Carried),
    ("ignore-route-errors", Carried),
    ("ignore-accidents", Carried),
    ("collision.action", CarriedUnless(Values::Word("remove"), REMOVES)),
    ("collision.*", Carried),
    ("max-num-vehicles", Carried),
    ("max-num-teleports", LeftOut("an episode ends at its end only")),
    ("scale", Carried),
    ("scale-suffix", Carried),
    ("time-to-teleport", Carried),
    ("time-to-teleport.ride", Silent),
    ("time-to-teleport.remove", CarriedUnless(Values::On, REMOVES)),
    ("time-to-teleport.*", Carried),
    ("waiting-time-memory", Carried),
    ("startup-wait-threshold", Carried),
    // Below 0, SUMO's default, cars wait until there is room.
    ("max-depart-delay", CarriedUnless(Values::NotNegative, DROPS)),
    ("sloppy-insert", Carried),
    ("eager-insert", Carried),
    ("emergency-insert", Carried),
    ("random-depart-offset", Carried),
    ("lanechange.duration", Refused("this program cannot replay a car between two lanes")),
    ("lanechange.overtake-right", Carried),
    ("tls.all-off", Refused("the agents run the lights")),
    ("tls.actuated.show-detectors", Silent),
    ("tls.*", Carried),
    ("time-to-impatience", Carried),
    ("default.*", Carried),
    ("emergencydecel.warning-threshold", Silent),
    ("routing-algorithm", Carried),
    ("weights.*", Carried),
    ("astar.*", Refused(READS)),
    ("replay-rerouting", Refused("routes of another run cannot be replayed here")),
    // What there is only with stops, persons and trains, which are refused where they stand.
    ("parking.maneuver", Silent),
    ("use-stop-ended", Silent),
    ("pedestrian.*", Silent),
    ("ride.*", Silent),
    ("persontrip.*", Silent),
    ("person-device.*", Silent),
    ("railway.*", Silent),
    ("railsignal-moving-block", Silent),
    ("overhead-wire.*", Silent),
    // Devices that change how cars drive, and others that only measure.
    ("device.rerouting.output", LeftOut(WRITES)),
    ("device.rerouting.threads", Silent),
    ("device.rerouting.*", Carried),
    ("device.toc.*", Refused(DEVICE)),
    ("device.driverstate.*", Refused(DEVICE)),
    ("device.bluelight.*", Refused(DEVICE)),
    ("device.taxi.*", Refused(DEVICE)),
    ("device.glosa.*", Refused(DEVICE)),
    ("device.*", Silent),
    ("emissions.*", Silent),
    ("phemlight-*", Silent),
    // Reports.
    ("verbose", Silent),
    ("print-options", Silent),
    ("xml-validation", Silent),
    ("xml-validation.*", Silent),
    ("no-warnings", Silent),
    ("aggregate-warnings", Silent),
    ("log", LeftOut(WRITES)),
    ("message-log", LeftOut(WRITES)),
    ("error-log", LeftOut(WRITES)),
    ("duration-log.*", Silent),
    ("no-step-log", Silent),
    ("step-log.period", Silent),
    // TraCI, random numbers, the mesoscopic model, the window.
    ("remote-port", LeftOut(TRACI)),
    ("num-clients", LeftOut(TRACI)),
    ("random", LeftOut(SEEDS)),
    ("seed", LeftOut(SEEDS)),
    ("thread-rngs", LeftOut(SEEDS)),
    ("mesosim", Refused(MESO)),
    ("meso-*", Silent),
    ("gui-*", Silent),
    ("quit-on-end", Silent),
    ("game", Silent),
    ("game.mode", Silent),
    ("start", Silent),
    ("delay", Silent),
    ("breakpoints", Silent),
    ("edgedata-files", Silent),
    ("demo", Silent),
    ("disable-textures", Silent),
    ("registry-viewport", Silent),
    ("window-size", Silent),
    ("window-pos", Silent),
    ("tracker-interval", Silent),
    ("osg-view", Silent),
];

/// Short and older names of options, by the whole name.
const OTHER_NAMES: [(&str, &str); 17] = [
    ("n", "net-file"),
    ("net", "net-file"),
    ("r", "route-files"),
    ("routes", "route-files"),
    ("a", "additional-files"),
    ("additional", "additional-files"),
    ("b", "begin"),
    ("e", "end"),
    ("v", "verbose"),
    ("W", "no-warnings"),
    ("l", "log"),
    ("log-file", "log"),
    ("s", "route-steps"),
    ("srand", "seed"),
    ("summary", "summary-output"),
    ("tripinfo", "tripinfo-output"),
    ("g", "gui-settings-file"),
];

/// Returns the whole name of an option.
pub(super) fn whole_name(name: &str) -> &str {
    OTHER_NAMES.iter().find(|(other, _)| *other == name).map_or(name, |(_, whole)| whole)
}

/// Returns what becomes of an option, or `None` if SUMO has none of this name.
pub(super) fn fate_of(name: &str) -> Option<Fate> {
    OPTIONS.iter().find(|(pattern, _)| fits(name, pattern)).map(|(_, fate)| *fate)
}

/// Returns why a parameter of a vehicle is refused: it gives the vehicle a device that is refused as an option, too.
/// `key`: such as `has.glosa.device` or `device.glosa.range`.
pub fn refused_parameter(key: &str, value: &str) -> Option<&'static str> {
    let key = key.to_ascii_lowercase();
    let device = key.strip_prefix("has.").and_then(|rest| rest.strip_suffix(".device"));
    let option = device.map_or(key.clone(), |device| format!("device.{device}.probability"));
    match fate_of(&option) {
        Some(Refused(why)) if option.starts_with("device.") && !is_off(value) => Some(why),
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

/// Returns whether a value switches an option off that would be refused otherwise.
pub(super) fn is_off(value: &str) -> bool {
    let no = ["false", "no", "off", "f", "-", ""].contains(&value.to_ascii_lowercase().as_str());
    no || value.parse::<f64>().is_ok_and(|number| number <= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_fits_decides() {
        assert_eq!(fate_of("time-to-teleport.ride"), Some(Silent));
        assert_eq!(fate_of("time-to-teleport.highways"), Some(Carried));
        assert_eq!(fate_of("fcd-output"), Some(LeftOut(WRITES)));
        assert_eq!(fate_of("fcd-output.geo"), Some(Silent));
        assert_eq!(fate_of("device.ssm.probability"), Some(Silent));
        assert_eq!(fate_of("device.toc.probability"), Some(Refused(DEVICE)));
        assert_eq!(fate_of("no-such-option"), None);
        assert_eq!((whole_name("b"), whole_name("begin")), ("begin", "begin"));
    }

    #[test]
    fn a_vehicle_gets_no_device_that_is_refused_as_an_option() {
        for (key, value, is_refused) in [
            ("has.glosa.device", "true", true),
            ("has.GLOSA.device", "1", true),
            ("has.glosa.device", "false", false),
            ("device.driverstate.initialAwareness", "0.5", true),
            ("has.rerouting.device", "true", false),
            ("has.battery.device", "true", false),
            ("lcStrategic", "1", false),
        ] {
            assert_eq!(refused_parameter(key, value).is_some(), is_refused, "{key} = {value}");
        }
    }

    #[test]
    fn options_by_which_cars_vanish_are_refused() {
        for (name, refused, carried) in [
            ("time-to-teleport.remove", "true", "false"),
            ("collision.action", "remove", "teleport"),
            ("max-depart-delay", "0", "-1"),
        ] {
            let Some(CarriedUnless(values, _)) = fate_of(name) else { panic!("{name} is always carried over") };
            assert_eq!([refused, carried].map(|value| values.has(value)), [true, false], "{name}");
        }
        assert_eq!(fate_of("time-to-teleport"), Some(Carried));
    }

    #[test]
    fn off_is_what_sumo_takes_for_it() {
        for value in ["false", "No", "0", "-1", "-1.0", "off"] {
            assert!(is_off(value), "{value}");
        }
        for value in ["true", "0.8", "1", "x", "file.xml"] {
            assert!(!is_off(value), "{value}");
        }
    }
}
