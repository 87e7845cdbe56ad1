//! Errors of SUMO and of this room.

/// The reason why SUMO, or this room before it, refused a call.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The thread already holds a simulation. Waiting for it would never end, because the same thread would have to
    /// drop it.
    #[error("this thread already holds a simulation, but libsumo has room for one per process; drop the first one")]
    AlreadyHeld,

    /// The shared library is missing, or it cannot be loaded.
    #[error("SUMO's library cannot be loaded: {text}; {way_out}")]
    Library { text: String, way_out: &'static str },

    /// SUMO could not load. Its text names the file and, for XML, the line.
    #[error("SUMO could not load `{options}`: {text}")]
    Load { options: String, text: String },

    /// SUMO refused a call. Its text names the thing at fault.
    #[error("SUMO could not {action}: {text}")]
    Refused { action: &'static str, text: String },

    /// A step or a reload failed, and the state of the simulation cannot be trusted.
    #[error("the simulation is broken until it is reloaded, because {cause}")]
    Broken { cause: String },

    #[error("light `{light}` has {links} links, but the state `{state}` has {letters} letters")]
    StateLength { light: String, links: usize, state: String, letters: usize },

    #[error("signal state `{state}`: {reason}; SUMO's letters are {alphabet}")]
    State { state: String, reason: String, alphabet: &'static str },

    #[error("car {car}: {reason}")]
    Insertion { car: u64, reason: String },

    /// The id comes from another simulation.
    #[error("no light is registered under number {number}: ids do not outlive their simulation")]
    UnknownLight { number: u32 },

    #[error("`{text}` contains a zero byte and cannot be passed to SUMO")]
    ZeroByte { text: String },
}

pub type Result<T> = std::result::Result<T, Error>;
