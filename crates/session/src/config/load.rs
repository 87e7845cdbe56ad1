//! From a file and `--set key=value` to a checked config. The file is a config, or a .sumocfg with default settings.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use toml::{Table, Value};

use super::RunConfig;
use crate::domains::{STARTING_FILE, learn_width};
use dials_core::outside::{in_plain_words, read_text};
use dials_learn::config::ShortForm;
use dials_traffic::any_light::AnyLight;
use dials_traffic::config::sumocfg::Sumocfg;
use dials_traffic::config::{ScenarioConfig, SeenCars};
use dials_traffic::controllers::ANY_LIGHT;
use dials_traffic::network::osm;

/// Largest config file. One with every key has three kibibytes.
pub const LARGEST_FILE: u64 = 1 << 20;

/// Reads `path`, applies the settings of `--set key=value`, and checks the result.
/// Relative paths in the config start at the folder of its file, and those of `settings` at the current folder.
pub fn load(path: &Path, settings: &[String]) -> Result<RunConfig> {
    let config = read(path, settings)?;
    ensure!(
        config.domain.is_some(),
        "{}: no domain: add a table [traffic] or [warehouse], as the files under configs/ do",
        path.display()
    );
    Ok(config)
}

/// Reads the config in a run directory. It may have no domain: then that of the run does not come from a config.
pub fn load_kept(path: &Path) -> Result<RunConfig> {
    read(path, &[])
}

fn read(path: &Path, settings: &[String]) -> Result<RunConfig> {
    let mut table = if Sumocfg::is_one(path) { naming(path)? } else { table_in(path)? };
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut given = Table::new();
    settings.iter().try_for_each(|setting| lay_over(&mut given, setting))?;
    // Only a first reading says which domain it is, whose defaults stand for what the file leaves out.
    let mut config = with(table.clone(), settings)?;
    let defaults = config.domain.as_ref().map_or("", |domain| domain.table().defaults());
    if !defaults.is_empty() {
        find_files(&mut config, &given, folder);
        let start = config.domain.as_ref().and_then(|domain| domain.file(STARTING_FILE));
        add_defaults(&mut table, &given, defaults, start.as_deref())?;
        config = with(table, settings)?;
    }
    find_files(&mut config, &given, folder);
    config.domain.iter_mut().try_for_each(|domain| domain.table_mut().complete())?;
    config.check().map_err(|error| anyhow!("{}: {error}", path.display()))?;
    learn_width(&mut config)?;
    Ok(config)
}

/// Lets the paths of the domain that are not `given` start at a folder.
fn find_files(config: &mut RunConfig, given: &Table, folder: &Path) {
    let Some(domain) = &mut config.domain else { return };
    let name = domain.name();
    let paths = domain.table_mut().paths().into_iter().filter(|(key, _)| !has(given, name, key));
    paths.for_each(|(_, file)| *file = folder.join(&file));
}

/// Returns a config with the settings laid over it. Errors name the key: the text was read before.
fn with(mut table: Table, settings: &[String]) -> Result<RunConfig> {
    settings.iter().try_for_each(|setting| lay_over(&mut table, setting))?;
    serde_path_to_error::deserialize(Value::Table(table)).map_err(|error| {
        let key = if error.path().iter().next().is_some() { format!("{}: ", error.path()) } else { String::new() };
        anyhow!("--set: {key}{}", in_plain_words(error.inner().to_string().trim()))
    })
}

/// Reads a config file. What is clearly something else is an error that says what it is.
fn table_in(path: &Path) -> Result<Table> {
    let shown = path.display();
    let inside = path.join("config.toml");
    ensure!(!inside.is_file(), "{shown}: is a run directory, not a config; its config is {}", inside.display());
    ensure!(!path.is_dir(), "{shown}: is a folder, not a config; name a .toml file in it, or a .sumocfg");
    ensure!(!osm::is_one(path), "{shown}: {}", osm::way_out(path));
    let text = read_text(path, LARGEST_FILE).with_context(|| format!("{shown}: cannot be read"))?;
    let parsed = text.parse::<Table>().ok();
    let is_experiment = parsed.as_ref().is_some_and(|table| table.contains_key("grid"));
    ensure!(!is_experiment, "{shown}: is an experiment file, not a config; use: dials-traffic experiment {shown}");
    ensure!(
        parsed.is_some() || path.extension().is_some_and(|ending| ending == "toml"),
        "{shown}: is not a config; a config is a .toml file such as configs/smoke_traffic.toml, or a .sumocfg"
    );
    let simulator = parsed.as_ref().and_then(|table| table.get("simulator")?.as_str());
    if let Some(form) = simulator.and_then(ShortForm::called).filter(|form| form.predictor.is_some()) {
        bail!(
            "{shown}: simulator = \"{}\": is a word for the command line; a config has two keys: {}",
            form.name,
            form.keys().trim().replace('\n', " and ")
        );
    }
    let in_file = |error: toml::de::Error| anyhow!("{shown}: {}", in_plain_words(&error.to_string()));
    // Read without the settings, because only these errors contain the line number.
    let _: RunConfig = toml::from_str(&text).map_err(in_file)?;
    // A config may hold numbers that a table cannot: those beyond 63 bits.
    toml::from_str(&text).map_err(in_file)
}

/// Returns a config that names nothing but a .sumocfg.
fn naming(scenario: &Path) -> Result<Table> {
    let name = scenario.file_name().and_then(|name| name.to_str());
    let name = name.with_context(|| format!("{}: is not UTF-8; rename it", scenario.display()))?;
    let traffic = Table::from_iter([("scenario".to_owned(), Value::String(name.to_owned()))]);
    Ok(Table::from_iter([("traffic".to_owned(), Value::Table(traffic))]))
}

fn has(config: &Table, table: &str, key: &str) -> bool {
    config.get(table).and_then(|table| table.get(key)).is_some()
}

/// Adds the keys that a config leaves out, with the defaults of its domain. `given`: the keys of `--set`; `start`: file of the
/// policy from which a run starts, if it is not that of the program.
fn add_defaults(table: &mut Table, given: &Table, defaults: &str, start: Option<&Path>) -> Result<()> {
    let mut defaults: Table = defaults.parse().expect("a test reads it");
    // Patience cannot be written as "none". A config, also a kept one, with epochs and no patience wants all of them.
    if [&*table, given].into_iter().any(|table| has(table, "aip", "epochs"))
        && let Some(Value::Table(aip)) = defaults.get_mut("aip")
    {
        aip.remove("patience");
    }
    // A memory or a rollout of one's own need not fit our number of copies of the GS.
    let own = ["memory", "rollout_steps"];
    if [&*table, given].into_iter().any(|table| own.iter().any(|key| has(table, "ppo", key)))
        && let Some(Value::Table(gs)) = defaults.get_mut("gs")
    {
        gs.remove("copies");
    }
    // A policy that starts from another one sees what that sees, decides as often, and has its layers.
    let word =
        |name: &str, key: &str| [given, &*table].into_iter().find_map(|table| table.get(name)?.get(key)?.as_str());
    let starts = word("policy", "start") == Some(ANY_LIGHT);
    let mut decision_s = decision_s(table, given);
    if starts {
        let policy = start.map_or_else(|| AnyLight::shipped(sees_a_part(table, given)), AnyLight::read);
        let policy = policy.context("traffic.any_light")?;
        let layers = policy.hidden().iter().map(|&width| Value::Integer(width as i64)).collect();
        inner(&mut defaults, "traffic").insert("observation".to_owned(), Value::String("lanes".to_owned()));
        inner(&mut defaults, "policy").insert("hidden".to_owned(), Value::Array(layers));
        decision_s.get_or_insert(policy.decision_s());
    }
    if let Some(seconds) = decision_s {
        let counts = ["memory", "rollout_steps", "minibatch"];
        let own_counts = [&*table, given].into_iter().any(|table| counts.iter().any(|key| has(table, "ppo", key)));
        decide_every(&mut defaults, seconds, own_counts);
    }
    // A network over lanes has no critic beside it.
    if word("traffic", "observation").map_or(starts, |observation| observation == "lanes") {
        inner(&mut defaults, "policy").remove("separate_critic");
    }
    fill_in(table, defaults);
    Ok(())
}

/// Returns whether a config says that agents see a part of the cars. Wrong values are refused elsewhere.
fn sees_a_part(table: &Table, given: &Table) -> bool {
    let seen = [given, table].into_iter().find_map(|table| table.get("traffic")?.get("seen_cars"));
    seen.is_some_and(|seen| seen.clone().try_into::<SeenCars>().is_ok_and(|seen| !seen.are_all()))
}

/// Returns the seconds between two decisions that a config of a scenario asks for. Wrong values are refused elsewhere.
fn decision_s(table: &Table, given: &Table) -> Option<u32> {
    let asked = [given, table].into_iter().find_map(|table| table.get("traffic")?.get("decision_s"))?;
    u32::try_from(asked.as_integer()?).ok().filter(|&seconds| seconds > 0)
}

/// Sets the seconds between two decisions. If these are fewer than by default, defaults that count decisions last as many seconds as
/// before. If they are more, counts stay: an update needs its samples. The counts of PPO also stay if the config has some of its own
/// (`own_counts`).
fn decide_every(defaults: &mut Table, seconds: u32, own_counts: bool) {
    let more = (f64::from(ScenarioConfig::default().decision_s) / f64::from(seconds)).max(1.0);
    let longer = |count: &mut Value| {
        let count_before = count.as_integer().expect("a count is a whole number");
        *count = Value::Integer(((count_before as f64 * more).round() as i64).max(1));
    };
    inner(defaults, "traffic").insert("decision_s".to_owned(), Value::Integer(seconds.into()));
    defaults.get_mut("total_steps").into_iter().for_each(longer);
    for (table, key) in [("evaluation", "every_steps"), ("aip", "dataset_steps"), ("aip", "retrain_every_steps")] {
        inner(defaults, table).get_mut(key).into_iter().for_each(longer);
    }
    let ppo = inner(defaults, "ppo");
    if let Some(gamma) = ppo.get_mut("gamma") {
        *gamma = Value::Float(gamma.as_float().expect("gamma is a number").powf(1.0 / more));
    }
    // A memory has whole rollouts, and a rollout whole minibatches.
    let count = |ppo: &Table, key: &str| ppo.get(key).and_then(Value::as_integer);
    if let (Some(rollout), false) = (count(ppo, "rollout_steps"), own_counts) {
        let now = ((rollout as f64 * more).round() as i64).max(1);
        for key in ["rollout_steps", "memory", "minibatch"] {
            if let Some(before) = count(ppo, key) {
                ppo.insert(key.to_owned(), Value::Integer(now * before / rollout));
            }
        }
    }
}

/// Returns a table in a table, which is made if it is not there.
fn inner<'a>(table: &'a mut Table, name: &str) -> &'a mut Table {
    let place = table.entry(name).or_insert_with(|| Value::Table(Table::new()));
    place.as_table_mut().expect("defaults are keys in tables")
}

/// Adds the keys that are not there yet.
fn fill_in(table: &mut Table, defaults: Table) {
    for (key, value) in defaults {
        match (table.get_mut(&key), value) {
            (None, value) => drop(table.insert(key, value)),
            (Some(Value::Table(inner)), Value::Table(defaults)) => fill_in(inner, defaults),
            (Some(_), _) => (),
        }
    }
}

pub fn to_toml(config: &RunConfig) -> Result<String> {
    Ok(toml::to_string(config)?)
}

fn lay_over(table: &mut Table, setting: &str) -> Result<()> {
    let (key, value) =
        setting.split_once('=').with_context(|| format!("--set {setting}: must be key=value, as in ppo.clip=0.2"))?;
    let (key, value) = (key.trim(), value.trim());
    // A number such as `1e6` is a float in TOML, but here it may mean a number of steps.
    let whole = |number: f64| number.fract() == 0.0 && number.abs() < 2_f64.powi(53);
    let written = value;
    // A bare word is a string: `simulator=gs` reads better than `simulator='"gs"'`.
    let value = match format!("value = {value}").parse::<Table>() {
        Ok(mut parsed) => match parsed.remove("value").expect("the table was written with this key") {
            Value::Float(number) if written.contains(['e', 'E']) && whole(number) => Value::Integer(number as i64),
            other => other,
        },
        Err(_) => Value::String(value.to_owned()),
    };
    if let Some(form) = value.as_str().filter(|_| key == "simulator").and_then(ShortForm::called) {
        table.extend(form.keys().parse::<Table>().expect("keys are TOML"));
        return Ok(());
    }
    let mut keys: Vec<&str> = key.split('.').collect();
    let last = keys.pop().expect("split yields at least one part");
    let mut place = table;
    for part in keys {
        place = match place.entry(part).or_insert_with(|| Value::Table(Table::new())) {
            Value::Table(inner) => inner,
            _ => bail!("--set {setting}: `{part}` holds a value, not keys"),
        };
    }
    place.insert(last.to_owned(), value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domains::DomainConfig;
    use dials_learn::config::{Predictor, Simulator};
    use dials_traffic::config::{EntryRule, TrafficConfig, TrafficTable};

    const SMALL: &str = "[traffic]\nnetwork = \"nets/grid_2x2\"\nlocal_network = \"nets/local\"\n";

    fn load_text(text: &str, settings: &[&str]) -> Result<RunConfig> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c.toml");
        std::fs::write(&path, text).unwrap();
        load(&path, &settings.iter().map(|&s| s.to_owned()).collect::<Vec<_>>())
    }

    fn traffic_of(config: RunConfig) -> TrafficConfig {
        let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = config.domain else {
            panic!("this config is of traffic")
        };
        table
    }

    fn error_of(text: &str, settings: &[&str]) -> String {
        load_text(text, settings).unwrap_err().to_string()
    }

    #[test]
    fn paths_count_from_the_config_file_and_those_of_settings_from_the_current_folder() {
        let network = |settings: &[&str]| traffic_of(load_text(SMALL, settings).unwrap()).network;
        assert!(network(&[]).is_absolute() && network(&[]).ends_with("nets/grid_2x2"));
        assert_eq!(network(&["traffic.network=sumo_nets/grid_2x2"]), Path::new("sumo_nets/grid_2x2"));
        assert!(network(&["traffic.local_network=sumo_nets/local"]).is_absolute(), "it is of the file");
        let table = "traffic={network='sumo_nets/grid_2x2', local_network='sumo_nets/local'}";
        assert_eq!(network(&[table]), Path::new("sumo_nets/grid_2x2"));
    }

    #[test]
    fn numbers_of_steps_may_have_an_exponent_or_underscores() {
        for steps in ["1e6", "1E+6", "1.0e6", "1_000_000"] {
            let config = load_text(SMALL, &[&format!("total_steps={steps}")]).unwrap();
            assert_eq!(config.learning.total_steps, 1_000_000, "{steps}");
        }
        assert_eq!(load_text(SMALL, &["ppo.clip=1e0"]).unwrap().learning.ppo.clip, 1.0);
        for steps in ["1.5", "1e-3", "many"] {
            let error = error_of(SMALL, &[&format!("total_steps={steps}")]);
            assert!(error.contains("total_steps: ") && error.contains("a whole number such as 1000000 is"), "{error}");
        }
    }

    #[test]
    fn what_is_no_config_is_called_by_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        ["run", "folder"].iter().for_each(|folder| std::fs::create_dir(place(folder)).unwrap());
        for (name, text) in [("a.net.xml", "<net/>"), ("b.toml", "[[grid]]\n"), ("run/config.toml", SMALL)] {
            std::fs::write(place(name), text).unwrap();
        }
        for (name, message) in [
            ("a.net.xml", "a.net.xml: is not a config; a config is a .toml file"),
            ("b.toml", "b.toml: is an experiment file, not a config; use: dials-traffic experiment"),
            ("run", "run: is a run directory, not a config; its config is "),
            ("folder", "folder: is a folder, not a config"),
        ] {
            let error = format!("{:#}", load(&place(name), &[]).unwrap_err());
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn a_way_to_train_is_one_word_on_the_command_line_and_two_keys_in_a_file() {
        for (word, simulator, predictor) in [
            ("dials", Simulator::Local, Predictor::Network),
            ("marginal-dials", Simulator::Local, Predictor::Marginals),
            ("gs", Simulator::Global, Predictor::Network),
        ] {
            let config = load_text(SMALL, &[&format!("simulator={word}")]).unwrap().learning;
            assert_eq!((config.simulator, config.predictor), (simulator, predictor), "{word}");
        }
        let last = load_text(SMALL, &["simulator=marginal-dials", "predictor=untrained"]).unwrap().learning;
        assert_eq!(last.short_form().name, "untrained-dials");
        let error = error_of(&format!("simulator = \"marginal-dials\"\n{SMALL}"), &[]);
        let keys = "simulator = \"local\" and predictor = \"marginals\"";
        assert!(error.contains("is a word for the command line") && error.ends_with(keys), "{error}");
    }

    #[test]
    fn settings_are_laid_over_the_file_and_come_back_from_the_text_of_the_config() {
        let settings = ["traffic.entry = max", "policy.hidden=[8, 4]", "traffic.initial_switch_bias=-1.5"];
        let more = ["traffic.until_first_switch=program", "traffic.clock=26", "traffic.clock_offsets=checkerboard"];
        let config = load_text(SMALL, &[settings, more].concat()).unwrap();
        assert_eq!((traffic_of(config.clone()).entry, &*config.learning.policy.hidden), (EntryRule::Max, &[8, 4][..]));
        assert_eq!(load_text(&to_toml(&config).unwrap(), &[]).unwrap(), config);
        let plain = to_toml(&load_text(SMALL, &[]).unwrap()).unwrap();
        assert!(!plain.contains("until_first_switch"), "{plain}");
    }

    #[test]
    fn sizes_that_no_machine_can_hold_are_refused() {
        let keys = ["traffic.horizon", "local_simulators.copies", "ppo.rollout_steps", "ppo.memory", "ppo.epochs"];
        let others = ["aip.dataset_steps", "aip.epochs", "evaluation.episodes", "evaluation.final_episodes"];
        for key in keys.into_iter().chain(others) {
            let error = error_of(SMALL, &[&format!("{key}=9000000000000000000")]);
            assert!(error.contains(&format!("{key} = 9000000000000000000: must be at most ")), "{error}");
        }
        let config = load_text(SMALL, &["aip.hidden=[]", "total_steps=10_000"]).unwrap();
        assert_eq!(config.learning.dataset_episodes(config.horizon()), 34);
        assert_eq!(config.learning.dataset_episodes(20_000), 2, "at least two: one is held out");
        let short = load_text(SMALL, &["aip.hidden=[]", "total_steps=1_000"]).unwrap();
        assert_eq!(short.learning.dataset_episodes(300), 4, "as many as the run has steps");
        assert_eq!(short.learning.first_dataset_episodes(300), 4, "as the others");
        let few_first = load_text(SMALL, &["total_steps=10_000", "aip.first_dataset_share=0.1"]).unwrap();
        let (first, later) = (few_first.learning.first_dataset_episodes(300), few_first.learning.dataset_episodes(300));
        assert_eq!((first, later), (4, 34));
        let too_few =
            load_text(SMALL, &["total_steps=10_000", "aip.batch=600", "aip.first_dataset_share=0.05"]).unwrap();
        assert_eq!(too_few.learning.first_dataset_episodes(300), 34, "two episodes, one held out, do not fill a batch");
        let longest = ["evaluation.every_steps=1000000000", "aip.retrain_every_steps=1000000000"];
        load_text(SMALL, &["total_steps=1000000000000000", longest[0], longest[1]]).unwrap();
    }

    #[test]
    fn bad_input_names_the_key_and_what_is_allowed() {
        let in_file = |line: &str| error_of(&format!("{line}\n{SMALL}"), &[]);
        let word = in_file("simulator = \"ials\"");
        assert!(word.contains("line 1") && word.contains("`ials` is no allowed value; allowed: `"), "{word}");
        assert!(error_of("", &[]).contains("no domain: add a table [traffic] or [warehouse]"));
        let average = "policy.average_every_steps=";
        let hidden = "must list at most 16 layers, each at most 4096 wide";
        for (settings, message) in [
            ("seed=-1", "`-1` is given, but a number from 0 to 18446744073709551615"),
            ("ppo.clip=high", "ppo.clip: \"high\" is given, but a number is needed"),
            ("ppo.clip", "must be key=value"),
            ("ppo.max_gradient_norm=nan", "for no limit"),
            ("ppo.max_gradient_norm=-0.5", "ppo.max_gradient_norm = -0.5"),
            ("ppo.minibatch=9000000000000000000", "must be a multiple of ppo.minibatch"),
            ("aip.retrain_every_steps=0", "must be at least 1 (the paper uses 100000"),
            ("aip.retrain_every_steps=100", "must be at least ppo.memory = 128"),
            ("aip.batch=9000000000000000000", "must not exceed the"),
            ("aip.patience=0", "aip.patience = 0: must be at least 1 (or leave it out)"),
            ("aip.weight_decay=-1", "aip.weight_decay = -1: must not be negative"),
            ("aip.weight_decay=10000", "multiplied by aip.learning_rate = 0.0001 it must be less than 1"),
            ("local_simulators.copies=3", "3 x 16 = 48"),
            ("warehouse.agents_per_side=2", "a run has one domain"),
            ("policy.hidden=[]", "must list one positive width per hidden layer"),
            ("policy.hidden=[4097]", hidden),
            ("policy.hidden=[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]", hidden),
            (&format!("{average}0"), "must be at least ppo.memory = 128"),
            (&format!("{average}5_000_000"), "policy.average_every_steps = 5000000: is larger than total_steps = "),
            (&format!("{average}10_000 policy.share=kind"), "does not go with policy.share"),
            ("traffic.until_first_switch=sumo", "allowed: `agent` or `program`"),
            ("traffic.clock_offsets=checkerboard", "traffic.clock_offsets needs a clock: add traffic.clock"),
            // 10^15 / 128 = 7.8 * 10^12 periods.
            ("total_steps=1000000000000000 evaluation.every_steps=128", "into 7812500000000 periods, but at most"),
        ] {
            let error = error_of(SMALL, &settings.split(' ').collect::<Vec<_>>());
            assert!(error.contains(message), "{error}");
        }
    }
}
