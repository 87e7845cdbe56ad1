//! A policy for any light: a network over a light's lanes and greens, with a file of its own, or one of this program.
//!
//! It knows nothing of the lights that it plays. What they show is in [`crate::lane_sets`].

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::agents::plan::AgentPlan;
use super::config::ScenarioConfig;
use super::lane_sets;
use dials_core::base::Rows;
use dials_core::domain::{Sets, StartingPolicy};
use dials_core::outside::read_bytes;
use stacknets::{Shape, Stack, StackToWrite, about_stacks, check_tensors, read_stack, write_stacks};

/// The networks that come with this program, for lights that see all cars and for those that see a part of them:
/// `models/README.md` says what they are.
const SHIPPED: &[u8] = include_bytes!("../../../models/any_light.safetensors");
const SHIPPED_PARTIAL: &[u8] = include_bytes!("../../../models/any_light_partial.safetensors");
/// Largest file. A network of 64 x 64 has 120 kB.
const MOST_BYTES: u64 = 16 << 20;
/// Key of the metadata that says what a file is.
const KEY: &str = "any_light";
const FORMAT: &str = "dials-traffic any-light 4";
/// Largest width of a layer, and number of layers. They come from a file.
const MOST_WIDE: usize = 4096;
const MOST_LAYERS: usize = 8;

/// A network that was trained on many lights.
#[derive(Clone, Debug)]
pub struct AnyLight {
    pub(crate) about: About,
    /// `[1, parameters]`
    parameters: Rows<f32>,
}

/// What a file says of its network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct About {
    format: String,
    hidden: Vec<usize>,
    /// How far before the stop line it sees cars, in metres.
    seen_m: f64,
    /// Seconds from one decision to the next.
    decision_s: u32,
    /// Names of the features of a lane and of a green.
    features: [Vec<String>; 2],
    trained_on: TrainedOn,
}

/// Lights of the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TrainedOn {
    lights: usize,
    /// Numbers of lanes and of greens that lights had.
    shapes: BTreeSet<[usize; 2]>,
    /// Highest speed limit of a lane, in metres per second.
    fastest_mps: f64,
}

impl AnyLight {
    /// Makes a network to be written, of the policy that all these lights have. `decision_s`: seconds from one decision to
    /// the next. `hidden`: widths of its layers.
    ///
    /// An error says why theirs fits no other lights.
    pub(crate) fn new(plans: &[AgentPlan], decision_s: u32, hidden: &[usize], parameters: &[f32]) -> Result<AnyLight> {
        let sets = plans.first().and_then(|plan| plan.sensor.sets());
        let sets = sets.context("its agents do not see lanes; train with traffic.observation = \"lanes\"")?;
        let speeds = plans.iter().flat_map(|plan| &plan.region.approaches).map(|lane| lane.speed_limit_mps);
        let trained_on = TrainedOn {
            lights: plans.len(),
            shapes: plans.iter().map(shape_of).collect(),
            fastest_mps: speeds.fold(0.0, f64::max),
        };
        let about = About {
            format: FORMAT.to_owned(),
            hidden: hidden.to_vec(),
            seen_m: sets.up_to_m,
            decision_s,
            features: lane_sets::features(),
            trained_on,
        };
        let mut row = Rows::new(1, parameters.len());
        row.row_mut(0).copy_from_slice(parameters);
        Ok(AnyLight { about, parameters: row })
    }

    /// Returns a network that comes with this program. `partial`: the one for lights that see a part of the cars. Both have one
    /// shape.
    pub fn shipped(partial: bool) -> Result<AnyLight> {
        match partial {
            false => AnyLight::of_bytes(SHIPPED, Path::new("models/any_light.safetensors")),
            true => AnyLight::of_bytes(SHIPPED_PARTIAL, Path::new("models/any_light_partial.safetensors")),
        }
    }

    /// Reads a file. An error says why it holds no such network.
    pub fn read(path: &Path) -> Result<AnyLight> {
        let bytes = read_bytes(path, MOST_BYTES).with_context(|| format!("{}: cannot be read", path.display()))?;
        AnyLight::of_bytes(&bytes, path)
    }

    pub(crate) fn checksum(path: &Path) -> Result<u32> {
        Ok(crc32fast::hash(
            &read_bytes(path, MOST_BYTES).with_context(|| format!("{}: cannot be read", path.display()))?,
        ))
    }

    /// `path` is for messages only.
    fn of_bytes(bytes: &[u8], path: &Path) -> Result<AnyLight> {
        let shown = path.display();
        let about = about_stacks(bytes);
        let about = about.get(KEY).with_context(|| {
            format!(
                "{shown}: holds no policy for any light; `dials-traffic export RUN --out FILE.safetensors` writes one"
            )
        })?;
        let about: About = serde_json::from_str(about)
            .with_context(|| format!("{shown}: its description is damaged, or of another version of this program"))?;
        ensure!(
            about.format == FORMAT && about.features == lane_sets::features(),
            "{shown}: was written by another version of this program, which described lights otherwise; train it again"
        );
        ensure!(
            (1..=MOST_LAYERS).contains(&about.hidden.len())
                && about.hidden.iter().all(|width| (1..=MOST_WIDE).contains(width)),
            "{shown}: its description is damaged: hidden = {:?}",
            about.hidden
        );
        ensure!(
            about.decision_s >= 1 && about.seen_m.is_finite() && about.seen_m > 0.0,
            "{shown}: its description is damaged: decision_s = {}, seen_m = {}",
            about.decision_s,
            about.seen_m
        );
        let layout = Shape::over_sets(lane_sets::sets(1, 1), about.hidden.clone()).layout();
        check_tensors(bytes, path, [("", &layout)])?;
        let parameters = read_stack(bytes, path, "", &layout, &["the policy"])?;
        Ok(AnyLight { about, parameters })
    }

    /// Writes a file that [`AnyLight::read`] reads.
    pub fn write(&self, path: &Path) -> Result<()> {
        let layout = self.shape().layout();
        let about = serde_json::to_string(&self.about).expect("text and finite numbers");
        let stack = StackToWrite { prefix: "", layout: &layout, rows: self.parameters.iter().collect() };
        write_stacks(&[stack], &HashMap::from([(KEY.to_owned(), about)]), path)
    }

    /// Returns a CRC-32 of what it is, however its file is written.
    pub(crate) fn digest(&self) -> u32 {
        let about = serde_json::to_vec(&self.about).expect("text and finite numbers");
        let mut digest = crc32fast::Hasher::new();
        digest.update(&about);
        self.parameters().iter().for_each(|number| digest.update(&number.to_le_bytes()));
        digest.finalize()
    }

    pub(crate) fn to_start(&self) -> StartingPolicy {
        StartingPolicy { hidden: self.about.hidden.clone(), parameters: self.parameters.clone() }
    }

    /// Returns the shape of its network for a light of one lane and one green. The parameters of all others are the same.
    pub fn shape(&self) -> Shape {
        self.shape_for(lane_sets::sets(1, 1))
    }

    fn shape_for(&self, sets: Sets) -> Shape {
        Shape::over_sets(sets, self.about.hidden.clone())
    }

    /// Returns the parameters of the network, in the order of its shape.
    pub fn parameters(&self) -> &[f32] {
        self.parameters.row(0)
    }

    /// Returns the widths of its layers.
    pub fn hidden(&self) -> &[usize] {
        &self.about.hidden
    }

    /// Returns the seconds from one decision to the next.
    pub fn decision_s(&self) -> u32 {
        self.about.decision_s
    }

    /// Returns how far before the stop line it sees cars, in metres.
    pub(crate) fn seen_m(&self) -> f64 {
        self.about.seen_m
    }

    /// Returns the network for lights with this much room.
    pub(crate) fn network(&self, sets: Sets) -> Stack {
        let mut stack = Stack::blank(1, self.shape_for(sets));
        stack.parameters_mut().load(&self.parameters);
        stack
    }

    /// Returns a sentence if agents of this scenario decide or see in another way than those of the training.
    pub(crate) fn other_view(&self, config: &ScenarioConfig) -> Option<String> {
        let About { seen_m, decision_s, .. } = self.about;
        let is_other = (seen_m, decision_s) != (config.approach_m, config.decision_s);
        is_other.then(|| {
            format!(
                "traffic.any_light: was trained with traffic.decision_s = {decision_s} and traffic.approach_m = {seen_m}, and here \
                 they are {} and {}",
                config.decision_s, config.approach_m
            )
        })
    }

    /// Returns what about a light is unlike all lights of the training, if anything is.
    pub(crate) fn unlike(&self, plan: &AgentPlan) -> Option<String> {
        let TrainedOn { shapes, fastest_mps, .. } = &self.about.trained_on;
        let [lanes, greens] = shape_of(plan);
        let is_like = |&[many, of]: &[usize; 2]| many.abs_diff(lanes) <= 1.max(lanes / 4) && of.abs_diff(greens) <= 1;
        if !shapes.iter().any(is_like) {
            return Some(format!("it has {lanes} lanes and {greens} greens"));
        }
        let mut speeds_mps = plan.region.approaches.iter().map(|lane| lane.speed_limit_mps);
        let too_fast = speeds_mps.find(|&speed_mps| speed_mps > 1.2 * fastest_mps);
        too_fast.map(|speed_mps| format!("cars come at {:.0} km/h", 3.6 * speed_mps))
    }
}

/// Returns the numbers of a light's lanes and greens.
fn shape_of(plan: &AgentPlan) -> [usize; 2] {
    [plan.region.approaches.len(), plan.greens()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{crossing, middle};

    /// Returns a policy for any light that was trained on `crossing`.
    fn made() -> AnyLight {
        let mut light = crossing();
        light.sensor.see(lane_sets::LaneSets::new(5, 4, 120.0));
        let parameters = Shape::over_sets(lane_sets::sets(1, 1), vec![3, 2]).layout().width();
        let parameters: Vec<f32> = (0..parameters).map(|number| number as f32 / 8.0).collect();
        AnyLight::new(&[light], 5, &[3, 2], &parameters).unwrap()
    }

    #[test]
    fn a_file_holds_the_policy_and_what_it_was_trained_on() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("any.safetensors");
        let policy = made();
        policy.write(&path).unwrap();
        let found = AnyLight::read(&path).unwrap();
        assert_eq!((&found.about, &found.parameters), (&policy.about, &policy.parameters));
        assert_eq!((found.about.seen_m, found.about.decision_s), (120.0, 5));
        assert_eq!(found.about.trained_on.shapes, BTreeSet::from([[5, 4]]));
        // The same parameters serve lights with more lanes and greens.
        assert_eq!(found.network(lane_sets::sets(30, 9)).parameters().values(), &policy.parameters);
    }

    #[test]
    fn files_of_another_kind_and_damaged_ones_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("any.safetensors");
        made().write(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let error = |bytes: &[u8]| format!("{:#}", AnyLight::of_bytes(bytes, Path::new("x")).unwrap_err());
        assert!(error(b"").starts_with("x: holds no policy for any light; `dials-traffic export"));
        assert!(error(&whole[..whole.len() - 1]).starts_with("x: "));
        // As long as before, so that the header keeps its length.
        let changed = |from: &str, to: &str| {
            assert_eq!(from.len(), to.len());
            let place = whole.windows(from.len()).position(|part| part == from.as_bytes()).expect("it is there");
            [&whole[..place], to.as_bytes(), &whole[place + from.len()..]].concat()
        };
        assert!(error(&changed("[3,2]", "[3,0]")).starts_with("x: its description is damaged: hidden = [3, 0]"));
        assert!(error(&changed("mean speed", "mean spied")).contains("was written by another version"));
        assert!(error(&changed("[3,2]", "[3,9]")).contains("must be F32"));
        assert!(error(&changed("120.0", "-99.0")).contains("seen_m = -99"));
    }

    #[test]
    fn a_light_is_unlike_if_its_shape_or_its_speed_was_not_in_the_training() {
        let policy = made();
        assert_eq!(policy.unlike(&crossing()), None);
        assert_eq!(policy.unlike(&middle()).as_deref(), Some("it has 4 lanes and 2 greens"));
        let mut fast = crossing();
        fast.region.approaches[1].speed_limit_mps = 25.0;
        assert_eq!(policy.unlike(&fast).as_deref(), Some("cars come at 90 km/h"));
    }

    #[test]
    fn a_policy_of_agents_that_see_something_else_is_none_for_any_light() {
        let error = AnyLight::new(&[crossing()], 5, &[3, 2], &[0.0; 9]).unwrap_err();
        assert!(error.to_string().starts_with("its agents do not see lanes"), "{error}");
    }

    #[test]
    fn the_policies_of_this_program_can_be_read_and_have_one_shape_and_view() {
        let [all, partial] = [false, true].map(|partial| AnyLight::shipped(partial).unwrap());
        let view = |policy: &AnyLight| (policy.hidden().to_vec(), policy.seen_m());
        assert_eq!(view(&all), view(&partial));
        assert_eq!((all.decision_s(), partial.decision_s()), (2, 5));
        assert_ne!(all.parameters(), partial.parameters());
    }
}
