//! `export`: writes the policies for use outside of this program.

use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

use crate::{cli, libtorch};
use dials_core::domain::{Kind, Kinds};
use dials_core::outside::{Printable, folder_of, is_printable};
use dials_learn::config::PolicyConfig;
use dials_learn::policy::{JointPolicy, PolicyStack};
use dials_session::error::{Error, Result};
use dials_session::outputs;
use dials_session::places::{self, Existing};
use dials_session::terminal::{answer, program};
use dials_session::{directory, domains};
use stacknets::{StackToWrite, stack_as_bytes};

pub(super) fn export(args: &cli::ExportArgs) -> Result<()> {
    let existing = Existing::of_named(args.force);
    if args.out.extension().is_some_and(|ending| ending == "safetensors") {
        return for_any_light(args, existing);
    }
    libtorch::check().map_err(Error::Usage)?;
    let run = directory::open(&args.run_dir).map_err(Error::Usage)?;
    run.note_still_trained(&args.run_dir);
    let files = files_of(&args.out, run.domain.kinds());
    files.iter().try_for_each(|file| check_free(file, existing)).map_err(Error::Usage)?;
    write_scripts(run.domain.kinds(), &run.config.learning.policy, &run.policies, &files, existing)
        .map_err(Error::Run)?;
    let of_kinds = run.domain.kinds().iter().zip(&files);
    let uses: Vec<String> = of_kinds.map(|(kind, file)| how_to_use(file, kind, &run.config.learning.policy)).collect();
    answer(uses.join("\n")).map_err(Error::Run)
}

/// Writes the one policy of all agents as a policy for any light.
fn for_any_light(args: &cli::ExportArgs, existing: Existing) -> Result<()> {
    let run = directory::open(&args.run_dir).map_err(Error::Usage)?;
    run.note_still_trained(&args.run_dir);
    check_free(&args.out, existing).map_err(Error::Usage)?;
    let made = || {
        let traffic = domains::traffic(&run.config)?.context("only traffic lights have a policy for any light")?;
        let first = run.policies.row(0);
        let are_one = (1..run.policies.len()).all(|agent| run.policies.row(agent) == first);
        ensure!(are_one, "its agents have policies of their own; train with policy.share = \"kind\"");
        traffic.any_light(&run.config.learning.policy.hidden, first)
    };
    let policy = made().with_context(|| args.run_dir.display().to_string()).map_err(Error::Usage)?;
    places::make_file(&args.out, existing, |beside| policy.write(beside)).map_err(Error::Run)?;
    let path = Printable(args.out.display());
    let uses = [
        format!("wrote {path}, a policy for any light; on other networks:"),
        format!("  {} evaluate {path} --on X.sumocfg", program()),
        format!("  {} baseline X.sumocfg --compare any-light:file={path},max-pressure", program()),
    ];
    answer(uses.join("\n")).map_err(Error::Run)
}

/// Returns the output files: `out` itself if all agents are of one kind.
/// Otherwise there is one file per kind, with the kind's name before the ending.
fn files_of(out: &Path, kinds: &Kinds) -> Vec<PathBuf> {
    let file = |kind: &Kind| {
        if kinds.count() == 1 {
            return out.to_owned();
        }
        let mut name = out.file_stem().unwrap_or_default().to_owned();
        name.push(format!(".{}", kind.name));
        if let Some(ending) = out.extension() {
            name.push(".");
            name.push(ending);
        }
        out.with_file_name(name)
    };
    kinds.iter().map(file).collect()
}

/// Writes one TorchScript module per kind. `files`: one path per kind.
fn write_scripts(
    kinds: &Kinds,
    config: &PolicyConfig,
    policies: &JointPolicy,
    files: &[PathBuf],
    existing: Existing,
) -> anyhow::Result<()> {
    for (kind, file) in kinds.iter().zip(files) {
        let mut stack = PolicyStack::blank(kind.agents.len(), &kind.spec, config);
        stack.load(&policies.pick(kind.agents.iter().map(|agent| agent.0)).into_rows());
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let failed = || format!("{}: cannot be written", file.display());
        let parameters = stack.parameters();
        let rows = parameters.values().iter().collect();
        let networks = stack_as_bytes(&StackToWrite { prefix: "", layout: parameters.layout(), rows })?;
        let module = libtorch::script(&networks, &name).with_context(failed)?;
        places::make_file(file, existing, |beside| Ok(fs::write(beside, &module)?))?;
    }
    Ok(())
}

fn check_free(file: &Path, existing: Existing) -> anyhow::Result<()> {
    let out = file.display();
    ensure!(!file.is_dir(), "{out}: is a directory; name a file with --out, such as policies.pt");
    let folder = folder_of(file);
    ensure!(folder.is_dir(), "{out}: there is no directory {}; make it first", folder.display());
    outputs::check_free(file, "--out", existing)
}

fn how_to_use(file: &Path, kind: &Kind, config: &PolicyConfig) -> String {
    let (agents, obs_dim, path) = (kind.agents.len(), kind.spec.obs_dim, Printable(file.display()));
    let actions = kind.spec.n_actions;
    let mut lines = vec![
        format!("wrote {path}; in Python:"),
        format!("  policies = torch.jit.load({})", to_load(file)),
        format!("  out = policies(obs)  # obs: float32 [{agents}, batch, {obs_dim}]"),
        format!("  logits, values = out[..., :{actions}], out[..., {actions}]"),
    ];
    let width = PolicyStack::shape(&kind.spec, config).state_width();
    if width > 0 {
        lines[2] = format!("  out = policies(obs, states)  # obs: float32 [{agents}, batch, {obs_dim}]");
        lines.push(format!(
            "  states = out[..., {}:]  # float32 [{agents}, batch, {width}], zeros when an episode begins",
            actions + 1
        ));
    }
    if kind.spec.masks {
        lines.push("  # before you choose, set the logits of the actions that are not allowed to -inf".to_owned());
    }
    lines.join("\n")
}

/// Returns a path as an argument of `torch.jit.load`. One that is not UTF-8 is opened by its bytes.
fn to_load(path: &Path) -> String {
    let escaped = |letter: char| match letter {
        '"' | '\\' => format!("\\{letter}"),
        _ if is_printable(letter) => letter.to_string(),
        _ => format!("\\U{:08x}", u32::from(letter)),
    };
    let escaped_byte = |&byte: &u8| match byte {
        b'"' | b'\\' => format!("\\{}", char::from(byte)),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    match path.to_str() {
        Some(text) => format!("\"{}\"", text.chars().map(escaped).collect::<String>()),
        None => {
            let bytes: String = path.as_os_str().as_bytes().iter().map(escaped_byte).collect();
            format!("open(b\"{bytes}\", \"rb\")")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::Domain;
    use dials_testkit::toy::{Coins, CoinsAndDice};
    use std::ffi::OsStr;

    #[test]
    fn a_path_is_written_as_python_writes_it() {
        let cases: [(&[u8], &str); 5] = [
            (b"a b/it's.pt", r#""a b/it's.pt""#),
            ("Süd/\"\\x41".as_bytes(), r#""Süd/\"\\x41""#),
            (b"\x1b[31m\n", r#""\U0000001b[31m\U0000000a""#),
            (b"a\xff7\"\\", r#"open(b"a\xff7\"\\", "rb")"#),
            (b"\xff\n \x1b", r#"open(b"\xff\x0a \x1b", "rb")"#),
        ];
        for (path, written) in cases {
            assert_eq!(to_load(Path::new(OsStr::from_bytes(path))), written);
        }
    }

    #[test]
    fn every_kind_has_a_file_of_its_own() {
        let files = |domain: &dyn Domain, out: &str| files_of(Path::new(out), domain.kinds());
        let paths = |paths: [&str; 2]| paths.map(PathBuf::from);
        assert_eq!(files(&Coins::new(1), "a/policies.pt"), [PathBuf::from("a/policies.pt")]);
        let kinds = CoinsAndDice::new(1);
        assert_eq!(files(&kinds, "a/policies.pt"), paths(["a/policies.coin.pt", "a/policies.die.pt"]));
        assert_eq!(files(&kinds, "plain"), paths(["plain.coin", "plain.die"]));
    }
}
