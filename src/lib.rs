//! Distributed influence-augmented local simulators (DIALS) for multi-agent reinforcement learning in large networked
//! systems, on traffic grids simulated by SUMO and on a native warehouse.
//!
//! Many agents learn at once. Instead of training them in one slow *global simulator* (GS), each learns in a *local
//! simulator* (LS) of its own region, into which an *approximate influence predictor* (AIP), a network that is trained
//! on the GS every F steps, samples what the rest of the system does. LS and AIP together are an
//! *influence-augmented local simulator* (IALS). Source: Suau et al., NeurIPS 2022.
//!
//! | paper | code |
//! |---|---|
//! | Algorithm 1, MARL with DIALS | [`training::dials`] |
//! | Algorithm 2, datasets from the GS | [`training::collect`] |
//! | Algorithm 3, trajectories with the IALS | [`training::ials`] |
//! | local-form fPOSG: GS, LS, influence sources, d-set | [`domain`] |
//! | AIPs and their training | [`influence`] |
//! | policies and PPO | [`policy`], [`training::ppo`] |
//! | "in parallel, for i in N" | [`training::fleet`], [`fleet`] |
//! | figures and tables of section Results and the appendix | [`experiment`], [`report`] |
//!
//! Rooms, in the order in which they may use each other (a test holds it): [`base`]; [`config`], [`domain`], [`sumo`];
//! [`nn`]; [`traffic`], [`warehouse`]; [`drawing`], [`plot`]; [`influence`], [`policy`]; [`evaluation`]; [`training`];
//! [`fleet`], [`records`]; [`terminal`], [`film`]; [`cost`]; [`report`], [`experiment`], [`mod@bench`]; [`run`] with
//! [`cli`] and [`error`]. Simulators never see a tensor. Training never sees a file, a process or SUMO. Only [`run`]
//! knows which domain and which fleet were chosen, and only one file there knows which domains there are.

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
pub mod nn;
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
