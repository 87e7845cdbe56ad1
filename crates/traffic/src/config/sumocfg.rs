//! A .sumocfg of the user: the files that it names, its times and the options that it sets.
//!
//! SUMO takes every element with a `value` for an option, whatever it stands in. So does this program.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};

pub use super::sumo_options::refused_parameter;
use super::sumo_options::{Fate, fate_of, is_off, whole_name};
use super::sumo_time::seconds;
use dials_core::outside::excerpt;
use dials_core::outside::tree::{Element, parse_file, read_whole};

/// Largest number of files of one kind.
const MOST_FILES: usize = 1000;
/// Latest second: 10 billion, some 300 years.
pub(crate) const MOST_SECONDS: u64 = 10_000_000_000;

/// Option that names when a waiting car is moved past the jam, and its value here if a .sumocfg does not name it.
///
/// It is SUMO's own default, in seconds, so that a scenario is what `sumo -c` plays. Without it some real maps jam for ever
/// under any light. It is written down, because another SUMO may have another default.
const TELEPORT: (&str, &str) = ("time-to-teleport", "300");

/// The content of a .sumocfg. Its files are not read yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Sumocfg {
    pub net: PathBuf,
    pub(crate) routes: Vec<PathBuf>,
    pub(crate) additional: Vec<PathBuf>,
    pub begin_s: u64,
    /// Second of the end, if the file names one.
    pub(crate) end_s: Option<u64>,
    /// Options that change traffic, by their names on SUMO's command line without `--`, in the order of the file. The
    /// time to teleport is always among them.
    pub(crate) options: Vec<(String, String)>,
    /// What of the file this program leaves out, a sentence each.
    pub(crate) left_out: Vec<String>,
}

impl Sumocfg {
    /// Reads the file. Its own paths are relative to its folder.
    pub fn read(path: &Path) -> Result<Sumocfg> {
        let root = parse_file(path, &read_whole(path)?)?;
        Sumocfg::of(&root, path.parent().unwrap_or(Path::new("")))
            .map_err(|error| anyhow!("{}: {error}", path.display()))
    }

    fn of(root: &Element, folder: &Path) -> Result<Sumocfg> {
        ensure!(
            ["configuration", "sumoConfiguration"].contains(&&*root.name),
            "is no configuration of SUMO: its root is <{}>, not <configuration>",
            excerpt(&root.name)
        );
        let mut reading = Reading::default();
        root.children.iter().try_for_each(|section| reading.section(section, folder))?;
        let Reading { given, net, routes, additional, begin_s, end_s, mut options, left_out } = reading;
        if !given.iter().any(|name| name == TELEPORT.0) {
            options.push((TELEPORT.0.to_owned(), TELEPORT.1.to_owned()));
        }
        let begin_s = begin_s.unwrap_or(0);
        if let Some(end) = end_s {
            ensure!(
                begin_s < end,
                "<begin value=\"{begin_s}\">: must be before <end value=\"{end}\">, so nothing would be simulated"
            );
        }
        let mut net = net.into_iter();
        let net = match (net.next(), net.next()) {
            (Some(net), None) => net,
            (None, _) => bail!("names no net; add <net-file value=\"...\"/>"),
            (Some(_), Some(second)) => bail!("<net-file>: names a second net, {}; leave one", second.display()),
        };
        Ok(Sumocfg { net, routes, additional, begin_s, end_s, options, left_out })
    }
}

/// What was read so far.
#[derive(Default)]
struct Reading {
    /// Names of the options so far.
    given: Vec<String>,
    net: Vec<PathBuf>,
    routes: Vec<PathBuf>,
    additional: Vec<PathBuf>,
    begin_s: Option<u64>,
    end_s: Option<u64>,
    options: Vec<(String, String)>,
    left_out: Vec<String>,
}

impl Reading {
    fn section(&mut self, element: &Element, folder: &Path) -> Result<()> {
        if let Some(value) = element.attribute("value").or_else(|| element.attribute("v")) {
            let name = whole_name(&element.name);
            self.option(name, value.trim(), folder)
                .with_context(|| format!("<{}>", excerpt(name)))
                .map_err(|error| anyhow!("{error:#}"))?;
        } else if element.children.is_empty() {
            let name = whole_name(&element.name);
            let files = ["net-file", "route-files", "additional-files", "begin", "end", "step-length"];
            ensure!(
                fate_of(name).is_none() && !files.contains(&name),
                "<{}>: has no attribute `value`; write <{0} value=\"...\"/>",
                excerpt(name)
            );
        }
        element.children.iter().try_for_each(|inner| self.section(inner, folder))
    }

    fn option(&mut self, name: &str, value: &str, folder: &Path) -> Result<()> {
        ensure!(!self.given.iter().any(|given| given == name), "is given twice; remove one of them");
        self.given.push(name.to_owned());
        if value.is_empty() {
            return Ok(());
        }
        match name {
            "net-file" => self.net = files(value, folder)?,
            "route-files" => self.routes = files(value, folder)?,
            "additional-files" => self.additional = files(value, folder)?,
            "begin" => self.begin_s = Some(whole_second(value)?.context("must not be negative")?),
            // SUMO takes a negative end for none.
            "end" => self.end_s = whole_second(value)?,
            "step-length" => ensure!(
                seconds(value)? == 1.0,
                "is {}, and this program simulates steps of 1 s; remove it or set it to 1",
                excerpt(value)
            ),
            _ => match fate_of(name) {
                None => bail!("is no option of SUMO that this program knows; remove it"),
                Some(Fate::CarriedUnless(values, why)) if values.has(value) => {
                    bail!("is {}, and {why}; remove it", excerpt(value))
                }
                Some(Fate::Carried | Fate::CarriedUnless(..)) => {
                    self.options.push((name.to_owned(), plain(value)?.to_owned()));
                }
                Some(Fate::LeftOut(why)) if !is_off(value) => self.left_out.push(format!("option {name}: {why}")),
                Some(Fate::Refused(why)) if !is_off(value) => {
                    bail!("is {}, and {why}; remove it", excerpt(value))
                }
                Some(Fate::LeftOut(_) | Fate::Refused(_) | Fate::Silent) => {}
            },
        }
        Ok(())
    }
}

/// Returns the value of an option that SUMO may get on its command line: one that it cannot take for another option.
fn plain(value: &str) -> Result<&str> {
    let takes_it_for_an_option = value.starts_with('-') && seconds(value).is_err();
    ensure!(!takes_it_for_an_option, "is `{}`, which is no value of it; remove it", excerpt(value));
    Ok(value)
}

/// Returns a time as a whole second, or `None` if it is negative.
fn whole_second(value: &str) -> Result<Option<u64>> {
    let time = seconds(value)?;
    ensure!(time.fract() == 0.0, "is {time}, and this program simulates steps of 1 s; set it to a whole second");
    ensure!(time <= MOST_SECONDS as f64, "is {time}: must be at most {MOST_SECONDS}");
    Ok((time >= 0.0).then_some(time as u64))
}

/// Returns the paths of a list of files, separated by commas.
fn files(value: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let paths = value.split(',').map(|name| file(name.trim())).collect::<Result<Vec<_>>>()?;
    ensure!(paths.len() <= MOST_FILES, "names {} files, and at most {MOST_FILES} are allowed", paths.len());
    Ok(paths.into_iter().map(|path| folder.join(path)).collect())
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

    fn error_of(options: &str) -> String {
        read(&format!("<net-file value='a'/>{options}")).unwrap_err().to_string()
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
            left_out: vec!["option tripinfo-output: this program writes its own measurements".to_owned()],
        };
        assert_eq!(found.unwrap(), expected);
    }

    #[test]
    fn cars_teleport_as_in_plain_sumo_unless_the_file_says_otherwise() {
        let found = read("<net-file value='a'/><end value='-1'/>").unwrap();
        assert_eq!(found.options, [("time-to-teleport".to_owned(), "300".to_owned())]);
        assert_eq!((found.begin_s, found.end_s), (0, None));
    }

    #[test]
    fn an_option_that_is_not_carried_over_is_refused_by_its_name() {
        for (options, told) in [
            ("<frobnicate value='1'/>", "<frobnicate>: is no option of SUMO that this program knows; remove it"),
            ("<begin value='1'/><b value='2'/>", "<begin>: is given twice; remove one of them"),
            ("<begin value='soon'/>", "<begin>: `soon` is no time: it must be seconds, such as 3600, or 01:00:00"),
            ("<begin value='-5'/>", "<begin>: must not be negative"),
            ("<end value='5.5'/>", "<end>: is 5.5, and this program simulates steps of 1 s; set it to a whole second"),
            ("<end value='1e11'/>", "<end>: is 100000000000: must be at most 10000000000"),
            ("<begin>5</begin>", "<begin>: has no attribute `value`; write <begin value=\"...\"/>"),
            ("<scale>5</scale>", "<scale>: has no attribute `value`; write <scale value=\"...\"/>"),
            (
                "<step-length value='0.1'/>",
                "<step-length>: is 0.1, and this program simulates steps of 1 s; remove it or set it to 1",
            ),
            (
                "<lateral-resolution value='0.8'/>",
                "<lateral-resolution>: is 0.8, and this program does not know the sublane model, in which cars share a \
                 lane; remove it",
            ),
            (
                "<load-state value='x'/>",
                "<load-state>: is x, and it reads a file that this program does not copy into a run directory; remove it",
            ),
            (
                "<time-to-teleport.remove value='true'/>",
                "<time-to-teleport.remove>: is true, and cars that SUMO takes off the road would count as cars that \
                 arrived; remove it",
            ),
            (
                "<max-depart-delay value='60'/>",
                "<max-depart-delay>: is 60, and cars that SUMO no longer lets wait would be missing from all figures; \
                 remove it",
            ),
            // A switch of SUMO takes no value that begins with `-`, but the next option.
            (
                "<eager-insert value='--tripinfo-output=x'/>",
                "<eager-insert>: is `--tripinfo-output=x`, which is no value of it; remove it",
            ),
            ("<net value='b'/>", "<net-file>: is given twice; remove one of them"),
            ("<r value='b,,c'/>", "<route-files>: names a file without a name; remove a comma"),
            (
                "<r value='${HOME}/b'/>",
                "<route-files>: names `${HOME}/b`, in which SUMO would put a variable of your shell; write the path \
                 itself",
            ),
            (
                "<r value='b%2'/>",
                "<route-files>: names `b%2`, with a `%` that stands for no character; rename the file",
            ),
            ("<r value='b%00'/>", "<route-files>: names `b%00`, which is no path"),
            (
                "<begin value='5'/><end value='5'/>",
                "<begin value=\"5\">: must be before <end value=\"5\">, so nothing would be simulated",
            ),
        ] {
            assert_eq!(error_of(options), told);
        }
        assert_eq!(read("").unwrap_err().to_string(), "names no net; add <net-file value=\"...\"/>");
        let two = read("<net-file value='a,b'/>").unwrap_err().to_string();
        assert_eq!(two, "<net-file>: names a second net, dir/b; leave one");
        let other = Sumocfg::of(&parse("<routes/>").unwrap(), Path::new("")).unwrap_err().to_string();
        assert_eq!(other, "is no configuration of SUMO: its root is <routes>, not <configuration>");
    }
}
