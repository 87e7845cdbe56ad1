//! A .sumocfg of the user: the files that it names, its times and the options that it sets.
//!
//! SUMO takes every element with a `value` for an option, whatever it stands in. So does this program.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::sumo_numbers::check_option;
use super::sumo_options::{Fate, fate_of, whole_name};
use super::sumo_time::seconds;
use crate::network::xml::{document, section};
use dials_core::outside::excerpt;
use dials_core::outside::tree::{Element, parse_file, read_whole};

const MOST_FILES: usize = 1000;
/// Names of the root element.
const ROOTS: [&str; 2] = ["configuration", "sumoConfiguration"];
/// Number of bytes in which the root element begins.
const MOST_PROLOG: u64 = 64 << 10;
/// Latest second: 10 billion, some 300 years.
pub(crate) const MOST_SECONDS: u64 = 10_000_000_000;

/// Option that names when a waiting car is moved past the jam, and its value here if a .sumocfg does not name it.
///
/// It is SUMO's own default, in seconds, so that a scenario is what `sumo -c` plays. Without it some real maps jam for ever
/// under any light. It is written down, because another SUMO may have another default.
const TELEPORT: (&str, &str) = ("time-to-teleport", "300");

/// The content of a .sumocfg. Its files are not read yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sumocfg {
    pub net: PathBuf,
    pub routes: Vec<PathBuf>,
    pub additional: Vec<PathBuf>,
    pub begin_s: u64,
    pub end_s: Option<u64>,
    /// SUMO's steps in a second.
    pub steps_per_s: u32,
    /// Options that change traffic, without `--`, in the order of the file. [`TELEPORT`] is always among them.
    pub options: Vec<(String, String)>,
    /// What this program makes of the rest, a sentence each.
    pub(crate) notes: Notes,
}

/// What is not simulated as SUMO would: a sentence each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Notes {
    /// What no simulator has.
    pub left_out: Vec<String>,
    /// What local simulators do without.
    pub without_locally: Vec<String>,
    /// Why there can be no local simulators.
    pub not_local: Vec<String>,
}

impl Notes {
    pub(crate) fn extend(&mut self, more: Notes) {
        self.left_out.extend(more.left_out);
        self.without_locally.extend(more.without_locally);
        self.not_local.extend(more.not_local);
    }
}

impl Sumocfg {
    /// Returns whether a file is a configuration of SUMO: by the ending of its name, or by its root element. Some end in
    /// `.sumo.cfg` or `.xml`.
    pub fn is_one(path: &Path) -> bool {
        if path.extension().is_some_and(|extension| extension == "sumocfg") {
            return true;
        }
        // Opening a pipe would wait for a writer.
        if !path.is_file() {
            return false;
        }
        let mut begin = Vec::new();
        let read = File::open(path).and_then(|file| file.take(MOST_PROLOG).read_to_end(&mut begin));
        read.is_ok() && root_name(&String::from_utf8_lossy(&begin)).is_some_and(|root| ROOTS.contains(&root))
    }

    /// Reads the file. Its own paths are relative to its folder.
    pub fn read(path: &Path) -> Result<Sumocfg> {
        let root = parse_file(path, &read_whole(path)?)?;
        Sumocfg::of(&root, path.parent().unwrap_or(Path::new("")))
            .map_err(|error| anyhow!("{}: {error}", path.display()))
    }

    fn of(root: &Element, folder: &Path) -> Result<Sumocfg> {
        ensure!(
            ROOTS.contains(&&*root.name),
            "is no configuration of SUMO: its root is <{}>, not <configuration>",
            excerpt(&root.name)
        );
        let mut found = Sumocfg { steps_per_s: 1, ..Sumocfg::default() };
        let mut given = Vec::new();
        collect(root, &mut given)?;
        for (number, (name, value)) in given.iter().enumerate() {
            let is_new = given[..number].iter().all(|(other, _)| other != name);
            ensure!(is_new, "<{}>: is given twice; remove one of them", excerpt(name));
            found.option(name, value, folder).map_err(|error| anyhow!("<{}>: {error:#}", excerpt(name)))?;
        }
        if !given.iter().any(|(name, _)| *name == TELEPORT.0) {
            found.options.push((TELEPORT.0.to_owned(), TELEPORT.1.to_owned()));
        }
        ensure!(!found.net.as_os_str().is_empty(), "names no net; add <net-file value=\"...\"/>");
        if let Some(end) = found.end_s {
            ensure!(
                found.begin_s < end,
                "<begin value=\"{}\">: must be before <end value=\"{end}\">, so nothing would be simulated",
                found.begin_s
            );
        }
        Ok(found)
    }

    fn option(&mut self, name: &str, value: &str, folder: &Path) -> Result<()> {
        if value.is_empty() {
            return Ok(());
        }
        match name {
            "net-file" => {
                let mut nets = files(value, folder)?;
                ensure!(nets.len() == 1, "names a second net, {}; leave one", nets[1].display());
                self.net = nets.remove(0);
            }
            "route-files" => self.routes = files(value, folder)?,
            "additional-files" => self.additional = files(value, folder)?,
            "begin" => self.begin_s = whole_second(value)?.context("must not be negative")?,
            "end" => self.end_s = last_second(value)?,
            "step-length" => self.steps_per_s = steps_per_s(value)?,
            _ => match fate_of(name, value) {
                None => bail!("is no option of SUMO that this program knows; remove it"),
                Some(Fate::Carried) => self.carry(name, value)?,
                Some(Fate::WithoutLocally(what)) => {
                    self.notes.without_locally.push(format!("option {name}: {what}"));
                    self.carry(name, value)?;
                }
                Some(Fate::NotLocal(why)) => {
                    self.notes.not_local.push(format!("option {name}: {why}"));
                    self.carry(name, value)?;
                }
                Some(Fate::LeftOut(why)) => self.notes.left_out.push(format!("option {name}: {why}")),
                Some(Fate::Refused(why)) => bail!("is {}, and {why}; remove it", excerpt(value)),
                Some(Fate::Silent) => {}
            },
        }
        Ok(())
    }

    fn carry(&mut self, name: &str, value: &str) -> Result<()> {
        let value = plain(value)?;
        check_option(name, value)?;
        self.options.push((name.to_owned(), value.to_owned()));
        Ok(())
    }
}

/// Returns the name of the first element of a text, after comments and declarations.
fn root_name(text: &str) -> Option<&str> {
    let mut rest = text;
    loop {
        rest = &rest[rest.find('<')? + 1..];
        if let Some(comment) = rest.strip_prefix("!--") {
            rest = &comment[comment.find("-->")?..];
        } else if !rest.starts_with(['?', '!']) {
            return rest.split(|letter: char| letter.is_whitespace() || "/>".contains(letter)).next();
        }
    }
}

fn collect<'a>(element: &'a Element, given: &mut Vec<(&'a str, &'a str)>) -> Result<()> {
    for child in &element.children {
        let name = whole_name(&child.name);
        if let Some(value) = child.attribute("value").or_else(|| child.attribute("v")) {
            given.push((name, value.trim()));
        } else if child.children.is_empty() {
            let read_here = ["net-file", "route-files", "additional-files", "begin", "end", "step-length"];
            let counts = !matches!(fate_of(name, "true"), None | Some(Fate::Silent | Fate::LeftOut(_)));
            ensure!(
                !counts && !read_here.contains(&name),
                "<{}>: has no attribute `value`; write <{0} value=\"...\"/>",
                excerpt(name)
            );
        }
        collect(child, given)?;
    }
    Ok(())
}

/// Returns the value of an option that SUMO may get on its command line: one that it cannot take for another option.
fn plain(value: &str) -> Result<&str> {
    let takes_it_for_an_option = value.starts_with('-') && seconds(value).is_err();
    ensure!(!takes_it_for_an_option, "is `{}`, which is no value of it; remove it", excerpt(value));
    Ok(value)
}

/// Returns how many steps of this length a second has. SUMO counts in milliseconds.
fn steps_per_s(length: &str) -> Result<u32> {
    let millis = (seconds(length)? * 1000.0).round();
    ensure!(
        millis >= 1.0 && 1000.0 % millis == 0.0,
        "is {}, and lights change at whole seconds; set it to a step of which a second has a whole number, such as 0.5 or 0.1",
        excerpt(length)
    );
    Ok((1000.0 / millis) as u32)
}

/// Returns the last whole second before an end. SUMO takes a negative end for none, and tools write one after many years for none.
fn last_second(value: &str) -> Result<Option<u64>> {
    let time = seconds(value)?;
    Ok((0.0..=MOST_SECONDS as f64).contains(&time).then_some(time as u64))
}

/// Returns a time as a whole second, or `None` if it is negative.
fn whole_second(value: &str) -> Result<Option<u64>> {
    let time = seconds(value)?;
    ensure!(time.fract() == 0.0, "is {time}, and lights change at whole seconds; set it to one");
    ensure!(time <= MOST_SECONDS as f64, "is {time}: must be at most {MOST_SECONDS}");
    Ok((time >= 0.0).then_some(time as u64))
}

fn files(value: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let paths = value.split(',').map(|name| file(name.trim())).collect::<Result<Vec<_>>>()?;
    ensure!(paths.len() <= MOST_FILES, "names {} files, and at most {MOST_FILES} are allowed", paths.len());
    Ok(paths.into_iter().map(|path| folder.join(path)).collect())
}

/// Returns a configuration of SUMO that names these files. Paths that are not absolute count from its folder.
///
/// Errors: a path is not UTF-8.
pub fn text(
    net: &Path,
    routes: &[PathBuf],
    additional: &[PathBuf],
    [begin_s, end_s]: [u64; 2],
    options: &[(String, String)],
) -> Result<String> {
    let list = |paths: &[PathBuf]| -> Result<String> {
        Ok(paths.iter().map(|path| encoded(path)).collect::<Result<Vec<_>>>()?.join(","))
    };
    let (net, routes, additional) = (encoded(net)?, list(routes)?, list(additional)?);
    let mut input = vec![("net-file", &*net), ("route-files", &*routes), ("additional-files", &*additional)];
    input.retain(|(_, files)| !files.is_empty());
    let [begin, end] = [begin_s, end_s].map(|second| second.to_string());
    let options: Vec<(&str, &str)> = options.iter().map(|(name, value)| (&**name, &**value)).collect();
    Ok(document("configuration", |xml| {
        section(xml, "input", &input)?;
        section(xml, "time", &[("begin", &begin), ("end", &end)])?;
        section(xml, "processing", &options)
    }))
}

/// Returns a path as [`file`] reads it.
fn encoded(path: &Path) -> Result<String> {
    let text = path.to_str().with_context(|| format!("{}: is not UTF-8; rename it", path.display()))?;
    Ok(text.replace('%', "%25").replace(',', "%2C").replace('$', "%24"))
}

/// Returns the name of a file as SUMO reads it: a `%` and two digits stand for a character.
fn file(name: &str) -> Result<String> {
    ensure!(!name.is_empty(), "names a file without a name; remove a comma");
    ensure!(
        !name.contains("${"),
        "names `{}`, in which SUMO would put a variable of your shell; write the path itself",
        excerpt(name)
    );
    let mut parts = name.split('%');
    let mut decoded = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let digits = part.get(..2).filter(|digits| digits.bytes().all(|digit| digit.is_ascii_hexdigit()));
        let code = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        let wrong = || format!("names `{}`, with a `%` that stands for no character; rename the file", excerpt(name));
        decoded.push(code.with_context(wrong)?);
        decoded.extend(&part.as_bytes()[2..]);
    }
    let decoded =
        String::from_utf8(decoded).with_context(|| format!("names `{}`, which is not UTF-8", excerpt(name)))?;
    ensure!(!decoded.contains('\0'), "names `{}`, which is no path", excerpt(name));
    Ok(decoded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::outside::tree::parse;

    fn read(options: &str) -> Result<Sumocfg> {
        let root = parse(&format!("<configuration>{options}</configuration>")).unwrap();
        Sumocfg::of(&root, Path::new("dir"))
    }

    #[test]
    fn a_configuration_that_is_written_is_read_as_what_it_was() {
        let [net, routes] = ["a, b%.net.xml", "c$&.rou.xml"].map(PathBuf::from);
        let text = text(&net, std::slice::from_ref(&routes), &[], [60, 3600], &[("scale".into(), "2".into())]).unwrap();
        let read = Sumocfg::of(&parse(&text).unwrap(), Path::new("")).unwrap();
        assert_eq!((read.net, read.routes, read.begin_s, read.end_s), (net, vec![routes], 60, Some(3600)));
        assert!(read.options.contains(&("scale".to_owned(), "2".to_owned())), "{:?}", read.options);
    }

    #[test]
    fn the_root_element_says_what_a_file_is() {
        for (text, root) in [
            ("<?xml version='1.0'?>\n<!-- <net> -->\n<configuration>", Some("configuration")),
            ("<net version='1.9'>", Some("net")),
            ("<a/>", Some("a")),
            ("total_steps = 5", None),
        ] {
            assert_eq!(root_name(text), root, "{text}");
        }
    }

    #[test]
    fn files_times_and_options_are_read_wherever_they_stand() {
        let found = read(
            "<input><net v='a.net.xml'/><route-files value='b.xml, /c%20d.xml'/></input><a value='../e.xml'/>\
             <time><begin value='07:00:00'/><end value='28800.00'/><step-length value='1'/></time><report/>\
             <processing><time-to-teleport value='120'/><eager-insert value='true'/></processing>\
             <tripinfo-output value='/etc/passwd'/><fcd-output.geo value='true'/><mesosim value='false'/>",
        );
        let options = [("time-to-teleport", "120"), ("eager-insert", "true")];
        let expected = Sumocfg {
            net: "dir/a.net.xml".into(),
            routes: vec!["dir/b.xml".into(), "/c d.xml".into()],
            additional: vec!["dir/../e.xml".into()],
            begin_s: 25_200,
            end_s: Some(28_800),
            options: options.map(|(name, value)| (name.to_owned(), value.to_owned())).to_vec(),
            steps_per_s: 1,
            notes: Notes {
                left_out: vec!["option tripinfo-output: this program writes its own measurements".to_owned()],
                ..Notes::default()
            },
        };
        assert_eq!(found.unwrap(), expected);
    }

    #[test]
    fn steps_are_parts_of_a_second_and_some_options_are_not_for_local_simulators() {
        for (length, steps) in [("1", 1), ("0.5", 2), (".1", 10), ("0.001", 1000), ("1.0000001", 1)] {
            let found = read(&format!("<net-file value='a'/><step-length value='{length}'/>")).unwrap();
            assert_eq!(found.steps_per_s, steps, "{length}");
        }
        let found = read("<net-file value='a'/><lateral-resolution value='0.8'/><device.glosa.range value='9'/>");
        let found = found.unwrap();
        assert_eq!(found.notes.not_local, ["option lateral-resolution: cars share a lane (the sublane model)"]);
        assert_eq!(found.notes.without_locally, ["option device.glosa.range: its cars drive like all others"]);
        assert_eq!(found.options.len(), 3);
    }

    #[test]
    fn cars_teleport_as_in_plain_sumo_unless_the_file_says_otherwise() {
        let found = read("<net-file value='a'/><end value='-1'/>").unwrap();
        assert_eq!(found.options, [("time-to-teleport".to_owned(), "300".to_owned())]);
        assert_eq!((found.begin_s, found.end_s), (0, None));
        let end =
            |value: &str| read(&format!("<net-file value='a'/><end value='{value}'/><no-step-log/>")).unwrap().end_s;
        assert_eq!(["300.5", "1e11", "00:10:00"].map(end), [Some(300), None, Some(600)]);
    }

    #[test]
    fn what_this_program_cannot_carry_over_is_refused_by_its_name() {
        for (options, message) in [
            ("<begin value='-5'/>", "<begin>: must not be negative"),
            ("<begin value='5.5'/>", "<begin>: is 5.5, and lights change at whole seconds; set it to one"),
            (
                "<step-length value='2'/>",
                "<step-length>: is 2, and lights change at whole seconds; set it to a step of",
            ),
            (
                "<step-length value='0.3'/>",
                "<step-length>: is 0.3, and lights change at whole seconds; set it to a step of",
            ),
            ("<step-length value='nan'/>", "<step-length>: `nan` is no time"),
            ("<begin value='1e11'/>", "<begin>: is 100000000000: must be at most 10000000000"),
            ("<scale>5</scale>", "<scale>: has no attribute `value`; write <scale value=\"...\"/>"),
            ("<r value='b,,c'/>", "<route-files>: names a file without a name; remove a comma"),
            ("<r value='${HOME}/b'/>", "<route-files>: names `${HOME}/b`, in which SUMO would put a variable"),
            ("<r value='b%2'/>", "<route-files>: names `b%2`, with a `%` that stands for no character"),
            ("<r value='b%00'/>", "<route-files>: names `b%00`, which is no path"),
        ] {
            let error = read(&format!("<net-file value='a'/>{options}")).unwrap_err().to_string();
            assert!(error.starts_with(message), "{error}");
        }
        let two = read("<net-file value='a,b'/>").unwrap_err().to_string();
        assert_eq!(two, "<net-file>: names a second net, dir/b; leave one");
        let other = Sumocfg::of(&parse("<routes/>").unwrap(), Path::new("")).unwrap_err().to_string();
        assert_eq!(other, "is no configuration of SUMO: its root is <routes>, not <configuration>");
    }
}
