//! The kinds of disturbances, and how they are dealt.

use rand::seq::SliceRandom;
use rand_xoshiro::Xoshiro256PlusPlus as Dice;

/// A disturbance. The coordinator is the process that a user starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Card {
    Kill,
    KillAtStart,
    KillAtFirstWrite,
    KillAtCheckpoint,
    Terminate,
    Interrupt,
    InterruptTwice,
    KillWorker,
    StopWorker,
    /// The coordinator is stopped for a while, and then continues.
    Pause,
    /// A second process resumes the same run.
    SecondResume,
    Evaluate,
    Report,
}

impl Card {
    /// All cards, and how many of each are in a deck. A deck has twelve that end a process.
    pub(super) const DECK: [(Card, usize); 13] = [
        (Card::Kill, 3),
        (Card::KillAtStart, 1),
        (Card::KillAtFirstWrite, 1),
        (Card::KillAtCheckpoint, 2),
        (Card::Terminate, 1),
        (Card::Interrupt, 1),
        (Card::InterruptTwice, 1),
        (Card::KillWorker, 1),
        (Card::StopWorker, 1),
        (Card::Pause, 1),
        (Card::SecondResume, 1),
        (Card::Evaluate, 1),
        (Card::Report, 1),
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Card::Kill => "SIGKILL",
            Card::KillAtStart => "SIGKILL right after the start",
            Card::KillAtFirstWrite => "SIGKILL at the first write",
            Card::KillAtCheckpoint => "SIGKILL at a checkpoint",
            Card::Terminate => "SIGTERM",
            Card::Interrupt => "SIGINT",
            Card::InterruptTwice => "SIGINT twice",
            Card::KillWorker => "SIGKILL of a worker",
            Card::StopWorker => "SIGSTOP of a worker",
            Card::Pause => "SIGSTOP, then SIGCONT",
            Card::SecondResume => "second resume",
            Card::Evaluate => "`evaluate` beside it",
            Card::Report => "`report` beside it",
        }
    }

    /// Returns whether it ends a process. A stopped worker is ended when patience is over.
    pub(super) fn kills(self) -> bool {
        !matches!(self, Card::Pause | Card::SecondResume | Card::Evaluate | Card::Report)
    }

    /// Returns whether it needs a coordinator that has just been started.
    pub(super) fn needs_a_start(self) -> bool {
        matches!(self, Card::KillAtStart | Card::KillAtFirstWrite)
    }

    pub(super) fn needs_a_worker(self) -> bool {
        matches!(self, Card::KillWorker | Card::StopWorker)
    }
}

/// Returns shuffled decks, one after another, up to the last of `kills` cards that end a process.
pub(super) fn deal(dice: &mut Dice, kills: u64) -> Vec<Card> {
    let (mut cards, mut dealt) = (Vec::new(), 0);
    while dealt < kills {
        let mut deck: Vec<Card> = Card::DECK.iter().flat_map(|&(card, count)| vec![card; count]).collect();
        deck.shuffle(dice);
        for card in deck {
            if dealt < kills || !card.kills() {
                cards.push(card);
                dealt += u64::from(card.kills());
            }
        }
    }
    cards
}
