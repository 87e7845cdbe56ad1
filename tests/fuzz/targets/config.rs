//! Config files with settings laid over them, as `train CONFIG --set KEY=VALUE` reads them.

use std::fs;

use dials_session::config::RunConfig;

use super::read_all;
use crate::place::work;
use crate::verdict::Verdict;

/// Lines that begin so hold a setting.
const SET: &str = "#set ";

const SETTINGS: &str = "total_steps = 4000
#set seed=18446744073709551615
#set ppo.clip = 0.2
#set policy.hidden=[8, 4]
#set simulator=gs
#set warehouse.horizon=7
#set numerics.vector_width=256-bit
[warehouse]
agents_per_side = 2
";

pub fn seeds() -> Vec<Vec<u8>> {
    let files = ["configs/smoke_traffic.toml", "configs/smoke_warehouse.toml", "configs/traffic_4.toml"];
    read_all(&files).into_iter().chain([SETTINGS.into()]).collect()
}

/// An accepted config comes back equal from its own text, and from the form in which workers get it.
pub fn call(bytes: &[u8]) -> Verdict {
    let path = work().join("config.toml");
    fs::write(&path, bytes).expect("a file to work with");
    let text = String::from_utf8_lossy(bytes);
    let settings: Vec<String> = text.lines().filter_map(|line| line.strip_prefix(SET)).map(str::to_owned).collect();
    let config = match dials_session::config::load(&path, &settings) {
        Ok(config) => config,
        Err(error) => return Verdict::refused(error),
    };
    let text = dials_session::config::to_toml(&config).expect("an accepted config can be written");
    let again = work().join("again.toml");
    fs::write(&again, &text).expect("a file to work with");
    let read = dials_session::config::load(&again, &[])
        .unwrap_or_else(|error| panic!("it is not read again: {error:#}\n{text}"));
    assert!(read == config, "it is read again as another config:\n{text}");
    let json = serde_json::to_string(&config).expect("an accepted config can be sent");
    let sent: RunConfig =
        serde_json::from_str(&json).unwrap_or_else(|error| panic!("no worker reads it: {error}\n{json}"));
    assert!(sent == config, "workers get another config:\n{json}");
    let periods = dials_learn::config::schedule(&config.learning);
    let ends = [periods.last().map_or(0, |last| last.end), config.learning.last_step()]
        .map(|step| config.learning.update_at_or_after(step));
    assert_eq!(ends[0], ends[1], "its periods end elsewhere:\n{text}");
    Verdict::Accepted
}
