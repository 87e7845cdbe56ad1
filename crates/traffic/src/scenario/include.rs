//! Files within files: `<include href="..."/>` anywhere, and the attribute `file` of elements that take their content from
//! another file. SUMO reads them while it reads the outer one. Here they become a part of it, so that a run directory has all.

use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::network::tree::{Element, parse_file, read_whole};
use dials_core::outside::excerpt;

/// Deepest file within a file. One that includes itself would have no end.
const DEEPEST: usize = 8;
/// Largest number of files within a file, and of their bytes. They might include each other many times.
const MOST_FILES: usize = 1000;
const MOST_BYTES: usize = 256 << 20;
/// Deepest element in the whole, so that a copy of it can be read again.
const DEEPEST_ELEMENT: usize = 32;

/// Elements whose attribute `file` names what they contain.
const WITH_CONTENT: [&str; 2] = ["rerouter", "variableSpeedSign"];

/// Puts the content of other files in its place. Returns whether there was any. `file`: path of the outer one, from which theirs
/// begin.
pub(super) fn put_in_place(file: &Path, root: &mut Element) -> Result<bool> {
    let is_changed = within(file, root, 0, &mut Budget::default())?;
    ensure!(
        !is_changed || depth(root) <= DEEPEST_ELEMENT,
        "{}: with the files that it includes, it has elements inside of elements, {DEEPEST_ELEMENT} deep and deeper",
        file.display()
    );
    Ok(is_changed)
}

/// What was read so far.
#[derive(Default)]
struct Budget {
    files: usize,
    bytes: usize,
}

fn depth(element: &Element) -> usize {
    1 + element.children.iter().map(depth).max().unwrap_or(0)
}

fn within(file: &Path, element: &mut Element, depth: usize, budget: &mut Budget) -> Result<bool> {
    let mut is_changed = false;
    let mut children = Vec::with_capacity(element.children.len());
    for mut child in std::mem::take(&mut element.children) {
        if child.name == "include"
            && let Some(href) = child.attribute("href")
        {
            children.extend(content(file, href, depth, budget)?);
            is_changed = true;
            continue;
        }
        is_changed |= within(file, &mut child, depth, budget)?;
        if WITH_CONTENT.contains(&&*child.name)
            && let Some(place) = child.attributes.iter().position(|(key, _)| key == "file")
        {
            let (_, name) = child.attributes.remove(place);
            // SUMO takes an empty name for none, and reads the other file first.
            if !name.is_empty() {
                child.children.splice(0..0, content(file, &name, depth, budget)?);
            }
            is_changed = true;
        }
        children.push(child);
    }
    element.children = children;
    Ok(is_changed)
}

/// Returns the elements of another file: what its root holds, or the root itself if it has a name.
fn content(outer: &Path, name: &str, depth: usize, budget: &mut Budget) -> Result<Vec<Element>> {
    ensure!(
        depth < DEEPEST,
        "{}: includes {}, files within files, {DEEPEST} deep and deeper; correct the paths",
        outer.display(),
        excerpt(name)
    );
    let path = outer.parent().unwrap_or(Path::new("")).join(name);
    let bytes = read_whole(&path).with_context(|| format!("{}: it includes {}", outer.display(), excerpt(name)))?;
    budget.files += 1;
    budget.bytes += bytes.len();
    ensure!(
        budget.files <= MOST_FILES && budget.bytes <= MOST_BYTES,
        "{}: includes more than {MOST_FILES} files, or more than {} MiB, the limits",
        outer.display(),
        MOST_BYTES >> 20
    );
    let mut root = parse_file(&path, &bytes)?;
    within(&path, &mut root, depth + 1, budget)?;
    Ok(if root.attribute("id").is_some() { vec![root] } else { root.children })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;
    use crate::network::xml;

    #[test]
    fn content_of_other_files_takes_the_place_of_their_names() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("in")).unwrap();
        let file = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        file("in/a.xml", "<routes><trip id='a'/><include href='b.xml'/></routes>");
        file("in/b.xml", "<vType id='b'/>");
        file("speeds.xml", "<vss><step time='1' speed='2'/></vss>");
        file("self.xml", "<routes><include href='self.xml'/></routes>");
        let place = dir.path().join("x.xml");
        let mut root = parse(
            "<routes><trip id='1'/><include href='in/a.xml'/><variableSpeedSign id='s' \
                              file='speeds.xml'/></routes>",
        )
        .unwrap();
        assert!(put_in_place(&place, &mut root).unwrap());
        let text = xml::text(&root).replace(['\n'], "").replace("    ", "");
        let expected = "<routes><trip id=\"1\"/><trip id=\"a\"/><vType id=\"b\"/><variableSpeedSign id=\"s\"><step time=\"1\" \
                        speed=\"2\"/></variableSpeedSign></routes>";
        assert!(text.ends_with(expected), "{text}");
        assert!(!put_in_place(&place, &mut root).unwrap(), "nothing is left");
        let mut root = parse("<routes><include href='self.xml'/></routes>").unwrap();
        assert!(put_in_place(&place, &mut root).unwrap_err().to_string().contains("8 deep and deeper"));
        file("many.xml", &format!("<routes>{}</routes>", "<include href='in/b.xml'/>".repeat(30)));
        let mut root = parse(&format!("<routes>{}</routes>", "<include href='many.xml'/>".repeat(40))).unwrap();
        assert!(put_in_place(&place, &mut root).unwrap_err().to_string().contains("includes more than 1000 files"));
        let mut root = parse("<routes><include href='no.xml'/></routes>").unwrap();
        let error = format!("{:#}", put_in_place(&place, &mut root).unwrap_err());
        assert!(
            error.contains("x.xml: it includes no.xml: ") && error.contains("no.xml: could not be read"),
            "{error}"
        );
    }
}
