//! Purposes of randomness: the one list of all uses of random numbers in this crate.

macro_rules! purposes {
    ($($(#[$doc:meta])* $name:ident = $text:literal,)*) => {
        /// Purpose of a random stream.
        ///
        /// A stream depends only on the text of its purpose. So a variant may be renamed, but its text must not change.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum RandomPurpose {
            $($(#[$doc])* $name,)*
        }

        impl RandomPurpose {
            #[cfg(test)]
            const ALL: &[RandomPurpose] = &[$(RandomPurpose::$name),*];

            /// Returns the text that names the stream.
            pub(crate) fn text(self) -> &'static str {
                match self {
                    $(RandomPurpose::$name => $text,)*
                }
            }
        }
    };
}

purposes! {
    /// First weights of the policies.
    Policy = "policy",
    /// First weights of the AIPs.
    Aip = "aip",
    /// Order of the minibatches of a policy.
    PolicyMinibatches = "policy minibatches",
    /// Order of the minibatches of an AIP.
    AipMinibatches = "aip minibatches",
    /// Actions that are drawn from a policy or by a random controller.
    Acting = "acting",
    /// Influence sources that are drawn from an AIP.
    Influence = "influence",
    /// Episodes of the simulators that policies train on.
    TrainingEpisodes = "training episodes",
    /// Episodes of the GS that AIPs are trained on.
    Collection = "collection",
    /// Episodes of the GS that the loss of AIPs is measured on.
    AipLoss = "aip loss",
    /// Episodes of the GS in which a controller is imitated.
    Demonstrations = "demonstrations",
    /// Slips in these episodes.
    Slips = "slips",
    /// Order of the minibatches of an imitation.
    ImitationMinibatches = "imitation minibatches",
    /// Episodes of evaluations.
    Evaluation = "evaluation",
    /// Episodes that fixed-time lights are tuned on.
    Tuning = "tuning",
    /// Episodes in which Webster's controller measures flows.
    Webster = "webster",
    /// The episode in which visits to regions are recorded.
    Visits = "visits",
    /// Cars of a local simulator: when its window of the demand begins, and what arrives.
    LocalCars = "local cars",
    /// Generators of SUMO, one per lane.
    Lanes = "lanes",
    /// Items of the warehouse.
    Items = "items",
    /// Moves of robots without a policy.
    Robots = "robots",
    /// Noise of the toy domain.
    Noise = "noise",
    /// Actions with which a domain is checked.
    Actions = "actions",
    /// One agent of several.
    Agent = "agent",
    /// One copy of several.
    Copy = "copy",
    /// One episode of several.
    Episode = "episode",
    /// One moment of the training.
    Steps = "steps",
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_purposes_have_the_same_text() {
        let texts: HashSet<&str> = RandomPurpose::ALL.iter().map(|purpose| purpose.text()).collect();
        assert_eq!(texts.len(), RandomPurpose::ALL.len());
    }
}
