//! A plan of signals for the engineer: a page that stands alone, with a diagram for each light, and a table as CSV.
//!
//! - `ring`: the diagram of one program. The rest of this file fills the page and the table.

mod ring;

use anyhow::{Context, Result};

use crate::document::{Block, Document, Figure, Table};
use dials_core::base::counted;
use dials_core::domain::signal_sheet::{PhaseSheet, ProgramSheet, SignalSheet};
use dials_core::outside::csv_name;

pub use dials_core::domain::signal_sheet::PROGRAMS;

/// Names of the other files that `plan` writes: the table and the page.
pub const TABLE: &str = "plan.csv";
pub const PAGE: &str = "plan.html";

/// What stands on the page before the lights.
pub struct About {
    /// What the plan is for, and what it was made from.
    pub title: String,
    /// Sentences about the plan.
    pub words: Vec<String>,
    /// Delay of all that were compared: a header and rows.
    pub caption: String,
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Command that plays the plan, with an introduction.
    pub commands: Vec<(String, String)>,
    /// What was assumed, a sentence each.
    pub assumed: Vec<String>,
}

/// Returns the page: HTML that needs no other file.
pub fn page(about: &About, sheets: &[SignalSheet]) -> Result<String> {
    let mut blocks: Vec<Block> = about.words.iter().cloned().map(Block::Paragraph).collect();
    blocks.push(Block::Table(Table {
        caption: about.caption.clone(),
        header: about.header.clone(),
        rows: about.rows.clone(),
    }));
    for (words, command) in &about.commands {
        blocks.push(Block::Paragraph(words.clone()));
        blocks.push(Block::Code(vec![command.clone()]));
    }
    blocks.push(Block::Heading("What was assumed".to_owned()));
    blocks.push(Block::List(about.assumed.clone()));
    blocks.push(Block::Heading("All lights".to_owned()));
    blocks.push(Block::Table(all_lights(sheets)));
    blocks.push(Block::Figure(Figure {
        name: "legend".to_owned(),
        caption:
            "Colours of the diagrams. The upper bar is the ring: the phases in their order. Below it stands what each \
                  approach sees."
                .to_owned(),
        svg: ring::legend()?,
    }));
    for sheet in sheets {
        blocks.push(Block::Heading(title_of(sheet)));
        for program in &sheet.programs {
            blocks.push(Block::Figure(Figure {
                name: format!("{}-{}", sheet.light, program.id),
                caption: caption_of(program, sheet.programs.len()),
                svg: ring::ring(program)?,
            }));
            blocks.push(Block::Table(phases(program)));
        }
    }
    Ok(Document { title: about.title.clone(), blocks }.to_html())
}

fn title_of(sheet: &SignalSheet) -> String {
    match &sheet.streets[..] {
        [] => sheet.light.clone(),
        streets => format!("{} ({})", sheet.light, streets.join(", ")),
    }
}

fn caption_of(program: &ProgramSheet, programs: usize) -> String {
    let ProgramSheet { id, from_s, to_s, cycle_s, offset_s, phases, .. } = program;
    let when = if programs == 1 { String::new() } else { format!(", from {} to {}", clock(*from_s), clock(*to_s)) };
    match phases.iter().any(|phase| phase.limits_s.is_some()) {
        true => format!(
            "Program {id}{when}: actuated. The diagram shows each green with its mean length, {cycle_s} s for all."
        ),
        false => format!("Program {id}{when}: cycle {cycle_s} s, offset {offset_s} s."),
    }
}

fn all_lights(sheets: &[SignalSheet]) -> Table {
    let programs: usize = sheets.iter().map(|sheet| sheet.programs.len()).sum();
    let row = |(sheet, program): (&SignalSheet, &ProgramSheet)| {
        let greens: Vec<String> = program.phases.iter().map(green).collect();
        vec![
            title_of(sheet),
            clock(program.from_s),
            format!("{}", program.cycle_s),
            format!("{}", program.offset_s),
            greens.join(" + "),
        ]
    };
    let rows = sheets.iter().flat_map(|sheet| sheet.programs.iter().map(move |program| (sheet, program))).map(row);
    Table {
        caption: format!(
            "{} with {}. All times are in seconds.",
            counted(sheets.len(), "light"),
            counted(programs, "program")
        ),
        header: ["light", "from", "cycle", "offset", "greens"].map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

/// Returns the length of a green: a number, or the limits of an actuated one.
fn green(phase: &PhaseSheet) -> String {
    match phase.limits_s {
        Some([least, most]) => format!("{least} to {most}"),
        None => phase.green_s.to_string(),
    }
}

fn phases(program: &ProgramSheet) -> Table {
    let on_foot = program.phases.iter().any(|phase| phase.pedestrian_clearance_s > 0);
    let row = |(number, phase): (usize, &PhaseSheet)| {
        let serves = if phase.serves.is_empty() { "nobody".to_owned() } else { phase.serves.join("; ") };
        let mut row = vec![format!("{}: {serves}", number + 1), green(phase)];
        row.extend(on_foot.then(|| phase.pedestrian_clearance_s.to_string()));
        row.extend([phase.yellow_s, phase.all_red_s, phase.split_s()].map(|seconds| seconds.to_string()));
        row
    };
    let mut caption =
        "Phases in their order, with who has green. A split is green, yellow and all red. Seconds.".to_owned();
    let mut header = vec!["phase", "green"];
    if on_foot {
        caption += " On foot: at the end of the green, people have red for so long and end their way across.";
        header.push("on foot");
    }
    header.extend(["yellow", "all red", "split"]);
    Table {
        caption,
        header: header.into_iter().map(str::to_owned).collect(),
        rows: program.phases.iter().enumerate().map(row).collect(),
    }
}

/// Returns a second of the simulation as a time of day.
fn clock(second: u64) -> String {
    format!("{:02}:{:02}:{:02}", second / 3600, second / 60 % 60, second % 60)
}

/// Returns the plan as CSV: a line for each phase of each program of each light. All times are in seconds.
pub fn csv(sheets: &[SignalSheet]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "light",
        "streets",
        "program",
        "from_s",
        "to_s",
        "cycle_s",
        "offset_s",
        "phase",
        "split_s",
        "green_s",
        "pedestrian_clearance_s",
        "yellow_s",
        "all_red_s",
        "min_green_s",
        "max_green_s",
        "state",
        "serves",
    ])?;
    for sheet in sheets {
        for program in &sheet.programs {
            for (number, phase) in program.phases.iter().enumerate() {
                // Fixed greens have no limits.
                let limits =
                    phase.limits_s.map_or([const { String::new() }; 2], |limits| limits.map(|s| s.to_string()));
                let numbers = [program.from_s, program.to_s].map(|second| second.to_string()).into_iter();
                let numbers = numbers.chain([program.cycle_s, program.offset_s].map(|second| second.to_string()));
                let on_foot = phase.pedestrian_clearance_s;
                let of_phase = [phase.split_s(), phase.green_s, on_foot, phase.yellow_s, phase.all_red_s];
                let line = [csv_name(&sheet.light), csv_name(&sheet.streets.join(" / ")), csv_name(&program.id)];
                let line = line.into_iter().chain(numbers).chain([(number + 1).to_string()]);
                let line = line.chain(of_phase.map(|second| second.to_string())).chain(limits);
                writer.write_record(line.chain([phase.state.clone(), csv_name(&phase.serves.join("; "))]))?;
            }
        }
    }
    String::from_utf8(writer.into_inner().context("a CSV file in memory")?).context("only strings were written")
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::signal_sheet::{Aspect, SignalGroup};

    fn sheet() -> SignalSheet {
        let phase = |green_s, state: &str, serves: &str| PhaseSheet {
            green_s,
            pedestrian_clearance_s: 0,
            yellow_s: 3,
            all_red_s: 1,
            limits_s: None,
            state: state.to_owned(),
            serves: vec![serves.to_owned()],
        };
        let group = |name: &str, bars: &[(Aspect, u32)]| SignalGroup {
            name: name.to_owned(),
            on_foot: false,
            bars: bars.to_vec(),
        };
        let (green, yields) = (Aspect::Green, Aspect::YieldingGreen);
        SignalSheet {
            light: "<J1>".to_owned(),
            streets: vec!["High Street".to_owned(), "Bridge \"Road\"".to_owned()],
            programs: vec![ProgramSheet {
                id: "webster".to_owned(),
                from_s: 25_200,
                to_s: 28_800,
                cycle_s: 60,
                offset_s: 7,
                phases: vec![phase(30, "Gr", "High Street (e1)"), phase(22, "rg", "e2")],
                groups: vec![
                    group("High Street (e1)", &[(green, 30), (Aspect::Yellow, 3), (Aspect::Red, 27)]),
                    group("e2", &[(Aspect::Red, 34), (yields, 22), (Aspect::Yellow, 3), (Aspect::Red, 1)]),
                ],
            }],
        }
    }

    #[test]
    fn the_table_has_a_line_for_each_phase() {
        let text = csv(&[sheet()]).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert_eq!(
            lines[1],
            "<J1>,\"High Street / Bridge \"\"Road\"\"\",webster,25200,28800,60,7,1,34,30,0,3,1,,,Gr,High Street (e1)"
        );
        assert!(lines[2].contains(",60,7,2,26,22,0,3,1,,,rg,e2"), "{}", lines[2]);
    }

    #[test]
    fn the_page_stands_alone_and_escapes_names() {
        let about = About {
            title: "Plan".to_owned(),
            words: vec!["Some words.".to_owned()],
            caption: "Delay".to_owned(),
            header: vec!["who".to_owned(), "delay".to_owned()],
            rows: vec![vec!["program".to_owned(), "40".to_owned()]],
            commands: vec![("Play it:".to_owned(), "sumo -c a.sumocfg".to_owned())],
            assumed: vec!["Nothing.".to_owned()],
        };
        let html = page(&about, &[sheet()]).unwrap();
        assert!(html.contains("&lt;J1&gt; (High Street, Bridge &quot;Road&quot;)") && !html.contains("<J1>"), "{html}");
        assert!(!html.contains("src=") && !html.contains("http-equiv"), "it loads nothing");
        assert!(html.contains("cycle 60 s, offset 7 s"), "{html}");
        assert_eq!(clock(27_061), "07:31:01");
    }

    #[test]
    fn a_diagram_has_every_name_whole_and_the_cycle() {
        let mut sheet = sheet();
        sheet.programs[0].groups[0].name = "A very long name of a street that goes on and on ".repeat(4);
        let svg = ring::ring(&sheet.programs[0]).unwrap().file();
        let words: String = svg.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(words.matches("street").count(), 4);
        assert!(words.contains("e2") && words.contains("60 s"), "{words}");
    }
}
