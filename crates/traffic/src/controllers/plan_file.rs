//! `plan:file=DIR`: a plan that the command `plan` has written, also on other traffic than that for which it was made. SUMO plays its
//! programs.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};

use super::arguments::Arguments;
use super::{FILE, PLAN, with_file};
use crate::agents::plan::AgentPlan;
use crate::network::contents::Content;
use dials_core::domain::signal_sheet::PROGRAMS;
use dials_core::outside::{Printable, read_bytes};

/// Largest file of programs.
const MOST_BYTES: u64 = 256 << 20;
const WAY_OUT: &str = "name a directory that `dials-traffic plan` wrote for this network";

/// Returns the programs in the file or directory that the parameters name. Errors: there is none, or a light has no program in it.
pub(super) fn programs(arguments: &mut Arguments<'_>, plans: &[AgentPlan]) -> Result<Arc<str>> {
    let file = arguments.take(FILE)?;
    let file = file.ok_or_else(|| arguments.refuse(format!("needs a plan; write {PLAN}:{FILE}=DIR and {WAY_OUT}")))?;
    let path = path(Path::new(file));
    let content = Content::read(&path).with_context(|| format!("{}: is no plan; {WAY_OUT}", path.display()))?;
    let with_program: HashSet<&str> =
        content.root.all("tlLogic").filter_map(|program| program.attribute("id")).collect();
    let without = plans.iter().find(|plan| !with_program.contains(&*plan.light));
    if let Some(plan) = without {
        let (path, light) = (path.display(), Printable(&plan.light));
        return Err(arguments.refuse(format!("{path}: has no program for light {light}; {WAY_OUT}")));
    }
    Ok(content.text().into())
}

/// Returns the CRC-32 of the file with the programs.
pub(super) fn checksum(file: &Path) -> Result<u32> {
    let path = path(file);
    let bytes = read_bytes(&path, MOST_BYTES).with_context(|| format!("{}: cannot be read; {WAY_OUT}", path.display()));
    Ok(crc32fast::hash(&bytes?))
}

/// Returns whether a directory holds a plan.
pub fn is_plan(dir: &Path) -> bool {
    dir.join(PROGRAMS).is_file()
}

/// Returns the name of the controller that plays the plan in a directory. Errors: its path cannot stand in a name.
pub fn controller_of(dir: &Path) -> Result<String> {
    with_file(PLAN, dir)
}

/// Returns the directory or file of the plan that a controller of this name plays. Another controller: `None`.
pub fn plan_of(controller: &str) -> Option<&str> {
    controller.strip_prefix(PLAN)?.strip_prefix(":")?.strip_prefix(FILE)?.strip_prefix("=")
}

fn path(file: &Path) -> PathBuf {
    if file.is_dir() { file.join(PROGRAMS) } else { file.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::middle;
    use crate::controllers::recipe;

    #[test]
    fn a_plan_has_a_program_for_each_light() {
        let dir = tempfile::tempdir().unwrap();
        let name = controller_of(dir.path()).unwrap();
        let light = middle().light;
        let refused = || recipe(&name, &[middle()]).err().map(|error| format!("{error:#}"));
        assert!(!is_plan(dir.path()) && refused().unwrap().contains("programs.add.xml: is no plan; name a directory"));
        for lights in ["<tlLogic id=\"other\"/>", ""] {
            std::fs::write(dir.path().join(PROGRAMS), format!("<additional>{lights}</additional>")).unwrap();
            assert!(refused().unwrap().contains("has no program for light"), "{lights}");
        }
        let program = format!("<additional><tlLogic id=\"{light}\" programID=\"p\"/></additional>");
        std::fs::write(dir.path().join(PROGRAMS), program).unwrap();
        assert!(is_plan(dir.path()) && refused().is_none());
        assert!(recipe(PLAN, &[middle()]).err().unwrap().to_string().contains("needs a plan; write plan:file=DIR"));
    }
}
