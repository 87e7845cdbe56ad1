//! A folder with a scenario that tests break.

use std::fs;
use std::path::{Path, PathBuf};

use dials_session::config::{RunConfig, load};
use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::config::{ScenarioConfig, TrafficTable};
use dials_traffic::scenario::SumoScenario;
use tempfile::TempDir;

pub(super) const SUMOCFG: &str = "x.sumocfg";
pub(super) const NET: &str = "net.net.xml";
pub(super) const CARS: &str = "cars.rou.xml";
pub(super) const BUSES: &str = "buses.rou.xml";
pub(super) const MORE: &str = "more.add.xml";

pub(super) const CONFIGURATION: &str = r#"<configuration>
    <input>
        <net-file value="net.net.xml"/>
        <route-files value="cars.rou.xml,buses.rou.xml"/>
        <additional-files value="more.add.xml"/>
    </input>
    <time><begin value="100"/><end value="400"/></time>
    <processing><time-to-teleport value="300"/></processing>
    <output><tripinfo-output value="VICTIM"/></output>
</configuration>"#;

pub(super) const CAR_ROUTES: &str = r#"<routes>
    <route id="west" edges="e0_r0c1 r0c1_r0c0 r0c0_w0"/>
    <trip id="early" type="car" depart="50" from="w0_r0c0" to="r0c1_e0"/>
    <trip id="t" type="car" depart="120.00" from="w0_r0c0" to="r0c1_e0"/>
    <vehicle id="v" type="car" depart="130" route="west"/>
    <vehicle id="w" depart="00:02:20"><route edges="s0_r0c0 r0c0_r1c0"/></vehicle>
    <flow id="f" type="mixed" begin="150" end="390" period="8" from="n1_r1c1" to="r0c1_s1"/>
</routes>"#;

pub(super) const BUS_ROUTES: &str = r#"<routes>
    <vType id="bus" vClass="bus" length="12"/>
    <flow id="g" type="bus" begin="110" end="410" vehsPerHour="120" departSpeed="max"><route edges="w1_r1c0 r1c0_r1c1"/></flow>
</routes>"#;

pub(super) const ADDITIONAL: &str = r#"<additional>
    <vType id="car" sigma="0.5" length="4.3" speedDev="0.1"/>
    <vType id="lorry" vClass="truck" length="9"/>
    <vTypeDistribution id="mixed" vTypes="car lorry" probabilities="3 1"/>
    <inductionLoop id="loop" lane="w0_r0c0_0" pos="50" freq="60" file="VICTIM"/>
    <edgeData id="means" file="VICTIM"/>
</additional>"#;

/// A folder with a scenario on a grid of 2 x 2 lights, and a file of the user outside of it.
pub(super) struct Room {
    pub dir: TempDir,
}

impl Room {
    pub(super) fn new() -> Room {
        let room = Room { dir: tempfile::tempdir().unwrap() };
        let grid = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/grid_2x2.net.xml");
        fs::copy(grid, room.path(NET)).unwrap();
        for (name, text) in [(SUMOCFG, CONFIGURATION), (CARS, CAR_ROUTES), (BUSES, BUS_ROUTES), (MORE, ADDITIONAL)] {
            fs::write(room.path(name), text.replace("VICTIM", room.victim().to_str().unwrap())).unwrap();
        }
        fs::write(room.victim(), "precious").unwrap();
        room
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(super) fn victim(&self) -> PathBuf {
        self.path("victim.txt")
    }

    /// Replaces a text in a file once.
    pub(super) fn change(&self, file: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(file)).unwrap();
        assert!(text.contains(from), "{from} is not in {file}");
        fs::write(self.path(file), text.replacen(from, to, 1)).unwrap();
    }

    pub(super) fn config(&self, settings: &[&str]) -> anyhow::Result<RunConfig> {
        load(&self.path(SUMOCFG), &settings.iter().map(|&setting| setting.to_owned()).collect::<Vec<_>>())
    }

    pub(super) fn read(&self) -> anyhow::Result<SumoScenario> {
        SumoScenario::read(&table(self.config(&[])?))
    }

    /// Returns an error with `DIR/` for the folder.
    pub(super) fn error(&self) -> String {
        let opened = self.config(&[]).and_then(|config| Traffic::open_scenario(&table(config)));
        let error = opened.err().expect("this scenario is broken");
        format!("{error:#}").replace(&format!("{}/", self.dir.path().display()), "DIR/")
    }
}

pub(super) fn table(config: RunConfig) -> ScenarioConfig {
    let Some(DomainConfig::Traffic(TrafficTable::Scenario(table))) = config.domain else {
        panic!("the config is of a scenario")
    };
    table
}

/// Returns the names in a folder, sorted.
pub(super) fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}
