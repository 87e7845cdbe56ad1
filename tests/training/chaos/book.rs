//! What happened, in lines and in a table.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use super::cards::Card;
use super::stage::Domain;

/// What is wrong with a run after its disturbances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Fault {
    /// A file is not as in an undisturbed run.
    Different,
    /// A file that an undisturbed run does not have, or a temporary file.
    Leftover,
    /// A process that outlives its coordinator.
    Orphan,
    /// A panic, a hang, or an end that the disturbance does not explain.
    Failure,
}

#[derive(Default)]
pub(super) struct Book {
    played: BTreeMap<Card, [usize; Domain::ALL.len()]>,
    faults: BTreeMap<Fault, usize>,
    findings: Vec<String>,
    runs: usize,
    starts: usize,
}

impl Book {
    /// Notes a disturbance and prints its line.
    pub(super) fn disturbed(&mut self, domain: Domain, card: Card, words: &str) {
        self.played.entry(card).or_default()[domain as usize] += 1;
        println!("{:>4}  {:<17}  {:<28}  {words}", self.disturbances(|_| true), domain.name(), card.name());
    }

    /// Notes a run that is done.
    pub(super) fn done(&mut self, starts: usize) {
        self.runs += 1;
        self.starts += starts;
    }

    pub(super) fn found(&mut self, fault: Fault, words: String) {
        println!("{fault:?}: {words}");
        *self.faults.entry(fault).or_default() += 1;
        self.findings.push(format!("{fault:?}: {words}"));
    }

    pub(super) fn findings(&self) -> &[String] {
        &self.findings
    }

    fn disturbances(&self, which: impl Fn(Card) -> bool) -> usize {
        self.played.iter().filter(|(card, _)| which(**card)).map(|(_, counts)| counts.iter().sum::<usize>()).sum()
    }

    pub(super) fn table(&self, took: Duration, seed: u64) -> String {
        let names = Domain::ALL.map(Domain::name).join(" | ");
        let mut table = format!("\n| disturbance | {names} |\n|---{}|\n", "|---".repeat(Domain::ALL.len()));
        for (card, _) in Card::DECK {
            let counts = self.played.get(&card).copied().unwrap_or_default();
            let counts = counts.map(|count| count.to_string()).join(" | ");
            writeln!(table, "| {} | {counts} |", card.name()).expect("a string takes all");
        }
        let faults = |fault| self.faults.get(&fault).copied().unwrap_or(0);
        let (all, kills) = (self.disturbances(|_| true), self.disturbances(Card::kills));
        write!(
            table,
            "\nseed {seed}: {all} disturbances, of which {kills} end a process; {} runs, {} starts, {:.0} s\n\
             {} different, {} leftovers, {} orphans, {} failures\n",
            self.runs,
            self.starts,
            took.as_secs_f64(),
            faults(Fault::Different),
            faults(Fault::Leftover),
            faults(Fault::Orphan),
            faults(Fault::Failure)
        )
        .expect("a string takes all");
        table
    }
}
