//! What a run costs where none was measured: enough for a first guess of how long it takes.

/// Core-seconds and memory, measured on two cores of a cloud machine with the configs of this project.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughCosts {
    /// Training on local simulators, per agent and timestep.
    pub training_s: f64,
    /// Training on the GS, per agent and timestep.
    pub training_on_gs_s: f64,
    /// Collecting a dataset and training on it, per agent, GS step and epoch.
    pub influence_s: f64,
    /// Evaluation, per agent and step of an episode.
    pub evaluation_s: f64,
    /// Memory of each process, whatever it does; MiB.
    pub process_mb: f64,
    /// Memory for each agent, in all processes together; MiB.
    pub agent_mb: f64,
}

/// Of a domain that says nothing: about what ours cost.
impl Default for RoughCosts {
    fn default() -> Self {
        RoughCosts {
            training_s: 50e-6,
            training_on_gs_s: 50e-6,
            influence_s: 2e-6,
            evaluation_s: 15e-6,
            process_mb: 115.0,
            agent_mb: 6.0,
        }
    }
}
