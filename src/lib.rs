//! Distributed influence-augmented local simulators (DIALS) for multi-agent reinforcement learning in large networked
//! systems, on traffic grids simulated by SUMO and on a native warehouse.
//!
//! Many agents learn at once. They do not train in one slow *global simulator* (GS). Each agent learns in a *local
//! simulator* (LS) of its own region. An *approximate influence predictor* (AIP) samples what the rest of the system
//! does to this region. The AIP is a network that is retrained on data from the GS every F steps. LS and AIP together
//! are an *influence-augmented local simulator* (IALS). Source: Suau et al., NeurIPS 2022.
//!
//! | paper | code |
//! |---|---|
//! | Algorithm 1, MARL with DIALS | [`training::dials`] |
//! | Algorithm 2, datasets from the GS | [`training::collect`] |
//! | Algorithm 3, trajectories with the IALS | [`training::ials`] |
//! | local-form fPOSG: GS, LS, influence sources, d-set (the AIP's inputs) | [`domain`] |
//! | AIPs and their training | [`influence`] |
//! | policies and PPO | [`policy`], [`training::ppo`] |
//! | "in parallel, for i in N" | [`training::fleet`], [`fleet`] |
//! | figures and tables of section Results and the appendix | [`experiment`], [`report`] |
//!
//! The top-level modules are called rooms. A room may use only rooms above or beside it; a test checks this.
//!
//! | room | what is in it |
//! |---|---|
//! | [`base`] | seeds, rows of numbers, ids and units, stopwatches, statistics |
//! | [`outside`] | files and names that others wrote, read and shown safely |
//! | [`machine`] | limits of the machine: memory, open files, disks |
//! | [`config`] | the config: read once, checked once |
//! | [`domain`] | the traits between simulators and learning |
//! | [`sumo`] | libsumo behind a safe interface |
//! | [`nn`] | stacked networks, one per agent |
//! | [`traffic`], [`warehouse`] | the two domains |
//! | [`drawing`], [`plot`] | SVG drawing, and pictures of a traffic episode |
//! | [`influence`] | AIPs and other influence predictors |
//! | [`policy`] | policies, how they draw actions, and the memory that they learn from |
//! | [`evaluation`] | evaluation episodes on the GS, and their figures |
//! | [`training`] | Algorithms 1 to 3 and PPO |
//! | [`fleet`] | workers and their coordinator |
//! | [`records`] | run directories: writing and reading |
//! | [`terminal`] | printed lines, progress bars, Ctrl-C |
//! | [`film`] | films of episodes |
//! | [`cost`] | how often a run does what, and what that costs |
//! | [`report`] | figures and tables from run directories |
//! | [`experiment`] | grids of runs, described in one file |
//! | [`mod@bench`] | training speed of a config |
//! | [`run`], [`cli`], [`error`] | the subcommands, the command line, the errors |
//!
//! Simulators never see a tensor. Training never sees a file, a process or SUMO. Only [`run`] knows which domain and
//! which fleet were chosen. Only one file there knows all domains.

pub mod base;
pub mod bench;
pub mod cli;
pub mod config;
pub mod cost;
pub mod domain;
pub mod drawing;
pub mod error;
pub mod evaluation;
pub mod experiment;
pub mod film;
pub mod fleet;
pub mod influence;
pub mod live;
pub mod machine;
pub mod nn;
pub mod outside;
pub mod plot;
pub mod policy;
pub mod records;
pub mod report;
pub mod run;
pub mod sumo;
pub mod terminal;
pub mod traffic;
pub mod training;
pub mod warehouse;
