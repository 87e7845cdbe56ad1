//! What becomes of every option of SUMO that a .sumocfg can set.
//!
//! An option that changes traffic is carried over or refused, never dropped in silence. The rest is left out: this
//! program seeds, measures and writes by itself.
//!
//! Source: `sumo --help` of SUMO 1.15 and 1.28.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// Carried over: SUMO gets it in every simulation, and so does the copy in a run directory.
    Carried,
    /// Carried over, but local simulators do without it. The user gets what is different there.
    WithoutLocally(&'static str),
    /// Carried over, but there can be no local simulators. The user gets the reason.
    NotLocal(&'static str),
    /// Left out. The user gets the reason.
    LeftOut(&'static str),
    /// Left out in silence: it changes no traffic here and writes nothing of use.
    Silent,
    Refused(&'static str),
}

use Fate::{Carried, LeftOut, NotLocal, Refused, Silent, WithoutLocally};

/// Names of options by their fate. A `*` stands for any text. If several fit, the longest counts.
const OPTIONS: &[(Fate, &str)] = &[
    // Input and processing.
    (
        Refused("it reads a file that this program does not copy into a run directory"),
        "load-state weight-files astar.* alternative-net-file selection-file device.fcd-replay.*",
    ),
    (Silent, "load-state.* weight-attribute threads keep-after-arrival slope-centered"),
    (Carried, "junction-taz mapmatch.* step-method.ballistic extrapolate-departpos route-steps scale scale-suffix"),
    (Carried, "ignore-junction-blocker ignore-route-errors ignore-accidents collision.* intermodal-collision.*"),
    (Carried, "time-to-teleport time-to-teleport.* waiting-time-memory startup-wait-threshold time-to-impatience"),
    (Carried, "max-num-vehicles max-num-persons max-depart-delay sloppy-insert eager-insert emergency-insert"),
    (Carried, "insertion-checks random-depart-offset lanechange.overtake-right tls.* default.*"),
    (Carried, "routing-algorithm weights.*"),
    (Silent, "tls.actuated.show-detectors emergencydecel.warning-threshold"),
    (LeftOut("an episode ends at its end only"), "max-num-teleports"),
    (LeftOut("this program simulates single cars on lanes"), "mesosim"),
    (Silent, "meso-*"),
    (NotLocal("cars share a lane (the sublane model)"), "lateral-resolution"),
    (NotLocal("cars jump over intersections"), "no-internal-links"),
    (NotLocal("cars can be between two lanes"), "lanechange.duration"),
    (Refused("the agents run the lights"), "tls.all-off"),
    (Refused("routes of another run cannot be replayed here"), "replay-rerouting"),
    // Stops, persons and trains.
    (Carried, "parking.maneuver use-stop-ended use-stop-started pedestrian.* ride.* persontrip.* person-device.*"),
    (Carried, "railway.* railsignal-moving-block railsignal.* overhead-wire.*"),
    (LeftOut(MEASURED), "pedestrian.jupedsim.wkt pedestrian.jupedsim.py"),
    // Devices that change how cars drive, and others that only measure.
    (Carried, "device.rerouting.*"),
    (
        WithoutLocally("its cars drive like all others"),
        "device.toc.* device.driverstate.* device.bluelight.* device.taxi.* device.glosa.* device.friction.* \
         device.stationfinder.*",
    ),
    (LeftOut(MEASURED), "device.toc.file device.taxi.dispatch-algorithm.output device.taxi.idle-algorithm.output"),
    (Silent, "device.* device.rerouting.threads emissions.* phemlight-*"),
    // Output and reports.
    (LeftOut(MEASURED), "*-output device.rerouting.output netstate-dump save-state.* log message-log error-log"),
    (Silent, "*-output.* netstate-dump.* output-prefix output-suffix output.* write-metadata write-license"),
    (Silent, "precision precision.geo human-readable-time language log.*"),
    (Silent, "verbose print-options xml-validation xml-validation.* no-warnings aggregate-warnings"),
    (Silent, "duration-log.* no-duration-log no-step-log step-log.period netstate.* dump-empty-edges dump-precision"),
    (Silent, "vehroutes.* data-files measure version help S Q G D T d t H X x V configuration-file c configuration"),
    (LeftOut(MEASURED), "save-configuration* save-config* C save-template* save-schema save-commented"),
    // TraCI, random numbers, the window.
    (LeftOut("this program runs SUMO by itself"), "remote-port num-clients"),
    (LeftOut("this program seeds every episode by itself"), "random seed thread-rngs"),
    (Silent, "gui-* g quit-on-end game game.mode start delay breakpoints edgedata-files demo disable-textures"),
    (Silent, "registry-viewport window-size window-pos tracker-interval osg-view"),
];

const MEASURED: &str = "this program writes its own measurements";

/// Whole names of options, and their short and older ones.
const OTHER_NAMES: &[(&str, &str)] = &[
    ("net-file", "n net"),
    ("route-files", "r routes"),
    ("additional-files", "a additional"),
    ("begin", "b"),
    ("end", "e"),
    ("verbose", "v"),
    ("no-warnings", "W suppress-warnings"),
    ("netstate-dump", "netstate ndump"),
    ("vehroute-output", "vehroutes"),
    ("personroute-output", "personroutes"),
    ("weight-files", "w weights"),
    ("random", "abs-rand"),
    ("default.carfollowmodel", "carfollow.model"),
    ("device.rerouting.with-taz", "with-taz"),
    ("device.rerouting.threads", "routing-threads"),
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
    let patterns =
        OPTIONS.iter().flat_map(|(fate, names)| names.split_whitespace().map(move |pattern| (pattern, *fate)));
    let (_, fate) = patterns.filter(|(pattern, _)| fits(name, pattern)).max_by_key(|(pattern, _)| pattern.len())?;
    Some(if is_off(value) && !matches!(fate, Carried | WithoutLocally(_)) { Silent } else { fate })
}

/// Returns what is different in a local simulator for cars with this parameter, such as `has.glosa.device`.
pub(crate) fn without_locally(key: &str, value: &str) -> Option<&'static str> {
    let key = key.to_ascii_lowercase();
    let device = key.strip_prefix("has.").and_then(|rest| rest.strip_suffix(".device"));
    let option = device.map_or(key.clone(), |device| format!("device.{device}.probability"));
    match fate_of(&option, value) {
        Some(WithoutLocally(what)) if !is_off(value) => Some(what),
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
        assert_eq!(fate_of("railsignal-block-output", "1"), Some(LeftOut(MEASURED)));
        assert_eq!(fate_of("time-to-teleport.highways", "1"), Some(Carried));
        assert!(matches!(fate_of("fcd-output", "a"), Some(LeftOut(_))));
        assert_eq!(fate_of("fcd-output.geo", "1"), Some(Silent));
        assert_eq!(fate_of("device.ssm.probability", "1"), Some(Silent));
        assert!(matches!(fate_of("device.toc.probability", "1"), Some(WithoutLocally(_))));
        assert!(matches!(fate_of("device.toc.file", "a"), Some(LeftOut(_))));
        assert_eq!(fate_of("no-such-option", "1"), None);
        assert_eq!((whole_name("b"), whole_name("begin")), ("begin", "begin"));
    }

    #[test]
    fn what_is_off_is_neither_refused_nor_against_local_simulators() {
        assert!(matches!(fate_of("lateral-resolution", "0.8"), Some(NotLocal(_))));
        assert_eq!(fate_of("lateral-resolution", "0"), Some(Silent));
        assert!(matches!(fate_of("tls.all-off", "true"), Some(Refused(_))));
        assert_eq!(fate_of("tls.all-off", "false"), Some(Silent));
        assert_eq!(fate_of("max-depart-delay", "-1"), Some(Carried));
    }

    #[test]
    fn no_option_that_names_a_file_is_carried_over() {
        // What `sumo --help` of SUMO 1.28 calls FILE, but for the three that are read here.
        const FILES: &str = "configuration-file save-configuration save-template save-schema weight-files load-state \
            netstate-dump emission-output battery-output elechybrid-output chargingstations-output \
            overheadwiresegments-output substations-output fcd-output fcd-output.filter-edges.input-file person-fcd-output \
            device.ssm.filter-edges.input-file full-output queue-output vtk-output amitran-output summary-output \
            person-summary-output tripinfo-output personinfo-output vehroute-output personroute-output link-output \
            railsignal-block-output railsignal-vehicle-output bt-output lanechange-output stop-output collision-output \
            edgedata-output lanedata-output statistic-output deadlock-output save-state.prefix save-state.files \
            pedestrian.jupedsim.wkt pedestrian.jupedsim.py astar.all-distances astar.landmark-distances \
            device.rerouting.output log message-log error-log phemlight-path device.taxi.dispatch-algorithm.output \
            device.taxi.idle-algorithm.output device.fcd-replay.files gui-settings-file edgedata-files \
            alternative-net-file selection-file gui-testing.setting-output device.toc.file device.ssm.file";
        for option in FILES.split_whitespace() {
            let fate = fate_of(option, "a.xml");
            assert!(matches!(fate, None | Some(LeftOut(_) | Silent | Refused(_))), "{option}: {fate:?}");
        }
    }

    #[test]
    fn some_devices_are_missing_in_a_local_simulator() {
        for (key, value, is_missing) in [
            ("has.GLOSA.device", "1", true),
            ("has.glosa.device", "false", false),
            ("device.driverstate.initialAwareness", "0.5", true),
            ("has.rerouting.device", "true", false),
            ("lcStrategic", "1", false),
        ] {
            assert_eq!(without_locally(key, value).is_some(), is_missing, "{key} = {value}");
        }
    }
}
