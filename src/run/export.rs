//! `export`: the policies for use outside of this program.

use anyhow::ensure;

use super::directory;
use crate::cli;
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::nn::check_script;
use crate::records::atomic::{folder_of, write_beside};
use crate::terminal::answer;

pub fn export(args: &cli::Export) -> Result<()> {
    check_script().map_err(Error::Usage)?;
    let mut run = directory::open(&args.run_dir).map_err(Error::Usage)?;
    check_free(args).map_err(Error::Usage)?;
    run.stack.load(&run.policies);
    write_beside(&args.out, |beside| run.stack.write_script(beside)).map_err(Error::Usage)?;
    answer(how_to_use(args, &*run.domain, run.config.policy.recurrent)).map_err(Error::Run)
}

fn check_free(args: &cli::Export) -> anyhow::Result<()> {
    let out = args.out.display();
    ensure!(!args.out.is_dir(), "{out}: is a directory; name a file with --out, such as policies.pt");
    let folder = folder_of(&args.out);
    ensure!(folder.is_dir(), "{out}: there is no directory {} to write it into; make it first", folder.display());
    ensure!(args.force || !args.out.exists(), "{out}: exists already; name another file, or overwrite it with --force");
    Ok(())
}

fn how_to_use(args: &cli::Export, domain: &dyn Domain, recurrent: Option<usize>) -> String {
    let (agents, obs_dim, path) = (domain.agents(), domain.spec().obs_dim, args.out.display());
    let actions = domain.spec().n_actions;
    let mut lines = vec![
        format!("wrote {path}; in Python:"),
        format!("  policies = torch.jit.load({:?})", args.out),
        format!("  out = policies(obs)  # obs: float32 [{agents}, batch, {obs_dim}]"),
        format!("  logits, values = out[..., :{actions}], out[..., {actions}]"),
    ];
    if let Some(width) = recurrent {
        lines[2] = format!("  out = policies(obs, states)  # obs: float32 [{agents}, batch, {obs_dim}]");
        lines.push(format!(
            "  states = out[..., {}:]  # float32 [{agents}, batch, {width}], zeros where an episode begins",
            actions + 1
        ));
    }
    lines.join("\n")
}
