//! The list of all uses of random numbers.

named! {
    /// Purpose of a random stream.
    ///
    /// A stream depends only on the text of its purpose. So a variant may be renamed, but its text must not change.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum RandomPurpose {
        /// First weights of the policies.
        Policy = "policy",
        /// First weights of the AIPs.
        Aip = "aip",
        PolicyMinibatches = "policy minibatches",
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
        ImitationMinibatches = "imitation minibatches",
        Evaluation = "evaluation",
        /// Episodes that fixed-time lights are tuned on.
        Tuning = "tuning",
        /// Episodes in which Webster's controller measures flows.
        Webster = "webster",
        /// The episode in which visits to regions are recorded.
        Visits = "visits",
        /// Which one of several route files an episode plays.
        RouteFile = "route file",
        /// Cars of a local simulator: when its window of the demand begins, and what arrives.
        LocalCars = "local cars",
        /// Generators of SUMO, one per lane.
        Lanes = "lanes",
        /// Items of the warehouse.
        Items = "items",
        /// Moves of robots without a policy.
        Robots = "robots",
        Noise = "noise",
        /// Actions with which a domain is checked.
        Actions = "actions",
        Agent = "agent",
        Copy = "copy",
        Episode = "episode",
        /// One moment of the training.
        Steps = "steps",
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_purposes_have_the_same_text() {
        let texts: HashSet<&str> = RandomPurpose::ALL.iter().map(|purpose| purpose.name()).collect();
        assert_eq!(texts.len(), RandomPurpose::ALL.len());
    }
}
