//! `--plot`: draws an evaluation as SVG files.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::domain;
use super::outputs;
use super::places::{self, Existing};
use crate::config::Config;
use crate::domain::Domain;
use crate::evaluation::Evaluation;
use crate::plot::{self, About};
use crate::terminal::tell;
use crate::traffic::Traffic;
use crate::traffic::sim::recording::Tape;
use crate::traffic::sim::trace::trace;

/// The recording and the output directory of `--plot`. The pictures are drawn after the episodes.
pub struct Plots {
    dir: PathBuf,
    tape: Tape,
    /// Domain whose first episode is recorded on `tape`.
    traffic: Traffic,
}

impl Plots {
    /// Checks that pictures can be made in `dir`, before long work begins. `None`: the option was not given.
    pub fn asked_for(dir: Option<&Path>, config: &Config) -> Result<Option<Plots>> {
        let Some(dir) = dir else { return Ok(None) };
        outputs::check_free(dir, "--plot")?;
        let tape = Tape::default();
        let traffic = domain::open_recorded(config, &tape).context("--plot: nothing can be drawn")?;
        Ok(Some(Plots { dir: dir.to_owned(), tape, traffic }))
    }

    /// Returns the domain to play the episodes on.
    pub fn domain(&self) -> &dyn Domain {
        &self.traffic
    }

    pub fn draw(&self, evaluation: &Evaluation, about: &About) -> Result<()> {
        let recording = self.tape.take().context("no episode was recorded")?;
        let trace = trace(&recording)?;
        let corridor = &trace.corridors[(trace.corridors.len() - 1) / 2];
        let pictures = [
            ("space_time.svg", plot::space_time(corridor, trace.seconds, about)?),
            ("queues.svg", plot::queues(&trace, about)?),
            ("signals.svg", plot::signal_timing(&trace, about)?),
            ("returns.svg", plot::returns_map(&trace, &evaluation.returns, about)?),
        ];
        places::make(&self.dir, Existing::Refuse, |dir| {
            pictures.iter().try_for_each(|(name, svg)| dir.put(name, svg.file().as_bytes()))
        })?;
        tell(format_args!("drew {} into {}", pictures.map(|(name, _)| name).join(", "), self.dir.display()));
        Ok(())
    }
}
