//! The GS: the whole warehouse.

use super::hand_coded::{self, Rule};
use super::items::{self, Appearances};
use super::layout::FloorPlan;
use super::region::{self, Age, CENTRE, NEIGHBOURS, NO_ITEM, SHARED, SHELVES};
use super::scene;
use dials_core::base::{AgentId, Dice, Ragged, RandomPurpose, Seed};
use dials_core::domain::{
    Action, GlobalSimulator, InfluenceSample, JointPercept, JointTransition, Kinds, Measures, Result, Scene,
};

/// Name of the measure "items that a robot collected in an episode".
pub(crate) const ITEMS: &str = "items";

/// The warehouse GS: one row per learning robot. The other robots, in a ring around them, go for the closest item.
pub struct GlobalWarehouse {
    kinds: Kinds,
    layout: FloorPlan,
    /// Rule that the learning robots follow instead of their actions, for hand-coded baselines.
    rule: Option<Rule>,
    /// Whether the rule was asked for the next actions. Then the step carries out what it is given.
    advised: bool,
    moves: Vec<Action>,
    /// Cell of each robot within its region.
    cells: Vec<u8>,
    /// Shelf that each robot without a policy goes to.
    targets: Vec<Option<usize>>,
    dice: Vec<Dice>,
    ages: Vec<Age>,
    appearances: Vec<Appearances>,
    last: JointTransition,
    d_set_before: Ragged<f32>,
    sources: Ragged<u8>,
    tally: Collected,
}

#[derive(Clone, Debug, Default)]
struct Collected {
    steps: u64,
    collected: Vec<u64>,
    /// Sums over steps of the number of waiting items, and of their ages.
    waiting: u64,
    age: u64,
}

impl GlobalWarehouse {
    pub fn new(layout: &FloorPlan, horizon: usize, rule: Option<Rule>) -> Self {
        let kinds = Kinds::one(layout.learners().len(), region::spec(horizon));
        let (robots, last) = (layout.robots(), JointTransition::new(&kinds));
        GlobalWarehouse {
            rule,
            advised: false,
            moves: vec![0; layout.learners().len()],
            cells: vec![CENTRE; robots],
            targets: vec![None; robots],
            dice: vec![Seed::new(0).dice(); robots],
            ages: vec![NO_ITEM; layout.shelves().len()],
            appearances: vec![Appearances::default(); layout.shelves().len()],
            d_set_before: last.percept.d_set.clone(),
            last,
            sources: Ragged::new(kinds.specs().map(|spec| spec.sources.count())),
            tally: Collected::default(),
            layout: layout.clone(),
            kinds,
        }
    }

    fn ages_around(&self, robot: usize) -> [Age; SHELVES] {
        self.layout.region(robot).map(|shelf| self.ages[shelf])
    }

    /// Returns what a robot that follows a rule does now.
    fn ask(&mut self, rule: Rule, robot: usize) -> Action {
        let ages = self.ages_around(robot);
        hand_coded::decide(rule, &mut self.targets[robot], self.cells[robot], &ages, &mut self.dice[robot])
    }

    /// Moves all robots at once. Those without a policy decide by what they see before the move.
    fn move_robots(&mut self, actions: &[Action]) {
        let advised = std::mem::take(&mut self.advised);
        let mut agents = 0;
        for robot in 0..self.layout.robots() {
            let learns = self.layout.learners().get(agents) == Some(&robot);
            let rule = if learns { self.rule.filter(|_| !advised) } else { Some(Rule::ClosestItem) };
            let action = match rule {
                None => actions[agents],
                Some(rule) => self.ask(rule, robot),
            };
            if learns {
                self.moves[agents] = action;
                agents += 1;
            }
            self.cells[robot] = region::after_move(self.cells[robot], action);
        }
    }

    fn note_sources_and_rewards(&mut self) {
        for (agent, &robot) in self.layout.learners().iter().enumerate() {
            let neighbours = self.layout.neighbours(robot);
            for (side, (source, neighbour)) in self.sources.row_mut(agent).iter_mut().zip(neighbours).enumerate() {
                // The shelves to my right are on the neighbour's left.
                let shared = &SHARED[(side + 2) % NEIGHBOURS];
                *source = region::class_of(region::shelf_at(self.cells[neighbour]), shared);
            }
            let reward = region::reward(region::shelf_at(self.cells[robot]), &self.ages_around(robot));
            self.last.rewards[agent] = reward;
            self.tally.collected[agent] += u64::from(reward > 0.0);
        }
    }

    fn observe(&mut self) {
        for (agent, &robot) in self.layout.learners().iter().enumerate() {
            let ages = self.ages_around(robot);
            let percept = &mut self.last.percept;
            region::observe(self.cells[robot], &ages, percept.obs.row_mut(agent));
            percept.d_set.row_mut(agent).copy_from_slice(percept.obs.row(agent));
        }
    }
}

impl GlobalSimulator for GlobalWarehouse {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        let stream = items::episode(episode, 0, 0);
        let shelves = self.layout.shelves().iter();
        self.appearances = shelves.map(|&(row, col)| Appearances::of_shelf(stream, row, col)).collect();
        let robots = AgentId::all(self.layout.robots()).into_iter();
        self.dice = robots.map(|robot| episode.fork(RandomPurpose::Robots).for_agent(robot).dice()).collect();
        self.targets.fill(None);
        self.cells.fill(CENTRE);
        self.advised = false;
        self.ages.fill(NO_ITEM);
        self.tally = Collected { collected: vec![0; self.agents()], ..Collected::default() };
        items::appear(&mut self.ages, &mut self.appearances);
        self.observe();
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.d_set_before.copy_from(&self.last.percept.d_set);
        self.ages.iter_mut().for_each(|age| *age += Age::from(*age >= 0));
        self.move_robots(actions);
        self.note_sources_and_rewards();
        for robot in 0..self.layout.robots() {
            if let Some(shelf) = region::shelf_at(self.cells[robot]) {
                self.ages[self.layout.region(robot)[shelf]] = NO_ITEM;
            }
        }
        self.tally.steps += 1;
        for &age in self.ages.iter().filter(|&&age| age >= 0) {
            self.tally.waiting += 1;
            self.tally.age += age as u64;
        }
        items::appear(&mut self.ages, &mut self.appearances);
        self.observe();
        Ok(&self.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set_before, sources: &self.sources }
    }

    fn advise(&mut self, actions: &mut [Action]) -> bool {
        let Some(rule) = self.rule else { return false };
        for (agent, action) in actions.iter_mut().enumerate() {
            *action = self.ask(rule, self.layout.learners()[agent]);
        }
        self.advised = true;
        true
    }

    fn carried_out(&self, actions: &mut [Option<Action>]) {
        actions.iter_mut().zip(&self.moves).for_each(|(action, &made)| *action = Some(made));
    }

    fn measures(&mut self) -> Result<Measures> {
        let tally = &self.tally;
        let steps = tally.steps.max(1) as f64;
        Ok(Measures {
            per_agent: vec![(ITEMS.to_owned(), tally.collected.iter().map(|&items| items as f64).collect())],
            system: vec![
                ("waiting_items".to_owned(), tally.waiting as f64 / steps),
                ("mean_item_age".to_owned(), tally.age as f64 / tally.waiting.max(1) as f64),
            ],
        })
    }

    fn scene(&self) -> Option<Scene> {
        Some(scene::draw(&self.layout, &self.ages, &self.cells))
    }
}
