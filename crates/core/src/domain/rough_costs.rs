//! Rough costs of a run without measurements: enough for a first guess of how long it takes.

/// Core-seconds and memory, measured on two cores of a cloud machine with the configs of this project.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughCosts {
    /// Core-seconds of training on local simulators, per agent and timestep.
    pub training_s: f64,
    /// Core-seconds of training on the GS, per agent and timestep.
    pub training_on_gs_s: f64,
    /// Core-seconds of collecting a dataset and training on it, per agent, GS step and epoch.
    pub influence_s: f64,
    /// Core-seconds of evaluation, per agent and step of an episode.
    pub evaluation_s: f64,
    /// Memory of each process, whatever it does, in MiB.
    pub process_mb: f64,
    /// Memory for each agent, in all processes together, in MiB.
    pub agent_mb: f64,
}

/// Costs of a domain that gives none: about those of traffic and the warehouse.
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
