//! The shape of one local region: all that networks and learning need to know of a domain.

/// An action of one agent: an index below [`RegionSpec::n_actions`].
pub type Action = u8;

/// What one local region looks like. All regions of a domain have the same shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RegionSpec {
    /// Width of an observation `o_i`.
    pub obs_dim: usize,
    /// Width of the d-separating set, the part of the ALSH that the AIP is conditioned on at each step.
    pub d_set_dim: usize,
    pub n_actions: usize,
    pub sources: SourceSpec,
    /// Steps of an episode.
    pub horizon: usize,
}

/// The influence sources `u_i` of a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceSpec {
    /// Independent bits (traffic: did a car enter on this edge?), each predicted by one sigmoid.
    Binary { sources: usize },
    /// Independent choices of one class each (warehouse: where does this neighbour stand?), each predicted by one
    /// softmax. Class 0 stands for nothing happening.
    Categorical { sources: usize, classes: usize },
}

impl SourceSpec {
    /// How many influence sources there are: the width of a row of sources.
    pub fn count(self) -> usize {
        match self {
            SourceSpec::Binary { sources } | SourceSpec::Categorical { sources, .. } => sources,
        }
    }

    /// How many values a source can take.
    pub fn classes(self) -> usize {
        match self {
            SourceSpec::Binary { .. } => 2,
            SourceSpec::Categorical { classes, .. } => classes,
        }
    }

    /// How many logits an AIP puts out for them.
    pub fn logits(self) -> usize {
        match self {
            SourceSpec::Binary { sources } => sources,
            SourceSpec::Categorical { sources, classes } => sources * classes,
        }
    }
}
