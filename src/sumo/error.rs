//! What can go wrong with SUMO.

/// Why SUMO, or this room before it, refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Waiting for the other simulation would wait for ever: it is held by the thread that would wait.
    #[error("this thread already holds a simulation, and libsumo has room for one per process: drop the first one")]
    AlreadyHeld,

    /// SUMO's text names the file and, for XML, the line.
    #[error("SUMO could not load `{options}`: {text}")]
    Load { options: String, text: String },

    /// SUMO's text names the thing that it stumbled over.
    #[error("SUMO could not {action}: {text}")]
    Refused { action: &'static str, text: String },

    /// A step or a reload failed, and what is left of the simulation cannot be trusted.
    #[error("the simulation is broken until it is reloaded, because {cause}")]
    Broken { cause: String },

    #[error("light `{light}` has {links} links, but the state `{state}` has {letters} letters")]
    StateLength { light: String, links: usize, state: String, letters: usize },

    #[error("signal state `{state}`: {reason}; SUMO's letters are {alphabet}")]
    State { state: String, reason: String, alphabet: &'static str },

    #[error("car {car}: {reason}")]
    Insertion { car: u64, reason: String },

    /// An id that another simulation handed out.
    #[error("no light is registered under number {number}: ids do not outlive their simulation")]
    UnknownLight { number: u32 },

    #[error("`{text}` has a zero byte in it and cannot be handed to SUMO")]
    ZeroByte { text: String },
}

pub type Result<T> = std::result::Result<T, Error>;
