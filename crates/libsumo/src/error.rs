//! Errors of SUMO and of this crate.

/// The reason why SUMO, or this crate before it, refused a call.
///
/// SUMO's own words are in the field `text`, in one line, without prefixes such as `Error:`.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The thread already holds a simulation. Waiting for it would never end, because the same thread would have to
    /// drop it.
    #[error("this thread already holds a simulation, but libsumo has room for one per process; drop the first one")]
    AlreadyHeld,

    /// The shared library is missing, or it cannot be used.
    #[error("SUMO's library cannot be loaded: {text}; {way_out}")]
    Library {
        /// The library's file, who named it, and what is wrong with it.
        text: String,
        /// What to do.
        way_out: String,
    },

    /// SUMO could not load. Its text names the file and, for XML, the line.
    #[error("SUMO could not load `{options}`: {text}")]
    Load {
        /// The options of the call, with blanks between them.
        options: String,
        /// SUMO's message.
        text: String,
    },

    /// SUMO refused a call. Its text names the thing at fault.
    #[error("SUMO could not {action}: {text}")]
    Refused {
        /// What was asked, such as `set the lights`.
        action: &'static str,
        /// SUMO's message.
        text: String,
    },

    /// No network is loaded: it was not yet, or no longer.
    #[error("no network is loaded; load one with `reload`")]
    Unloaded,

    /// A step or a reload failed, and the state of the simulation cannot be trusted.
    #[error("the simulation is broken until it is reloaded, because {cause}")]
    Broken {
        /// Message of the error that broke it.
        cause: String,
    },

    /// The state has another number of letters than the light has links.
    #[error("light `{light}` has {links} links, but the state `{state}` has {} letters", .state.len())]
    StateLength {
        /// Name of the light.
        light: String,
        /// Number of its links.
        links: usize,
        /// The state, a letter per link.
        state: String,
    },

    /// The letters are no state of a light.
    #[error("signal state `{state}`: {reason}; SUMO's letters are {alphabet}")]
    State {
        /// The letters.
        state: String,
        /// What is wrong with them.
        reason: String,
        /// The letters that SUMO knows.
        alphabet: &'static str,
    },

    /// A position, a speed or a number of a car is none.
    #[error("car {car}: {reason}")]
    Insertion {
        /// Number of the car.
        car: u64,
        /// What is wrong with it.
        reason: String,
    },

    /// The id comes from another simulation.
    #[error("no light is registered under number {number}: ids do not outlive their simulation")]
    UnknownLight {
        /// Number of the light.
        number: u32,
    },

    /// C ends a text at a zero byte.
    #[error("`{text}` contains a zero byte and cannot be passed to SUMO")]
    ZeroByte {
        /// The text.
        text: String,
    },
}

/// A result with an [`enum@Error`] of this crate.
pub type Result<T> = std::result::Result<T, Error>;
