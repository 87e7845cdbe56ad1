//! What SUMO itself tells of every car's trip: its tripinfo output, read when an episode is over.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Seek};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result, bail};
use quick_xml::Reader;
use quick_xml::events::Event;

/// Where SUMO writes the trips of an episode: a file without a name, so that a killed process leaves none behind.
pub struct TripFile {
    file: File,
}

/// Means over the trips of an episode, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trips {
    /// From entering the net to leaving it or to the end of the episode, over all cars that entered.
    pub travel_time_s: f64,
    /// Time lost to driving slower than allowed, and to waiting at the boundary before entering; over all cars, those that
    /// never entered too. Source: Ault and Sharon, "Reinforcement Learning Benchmarks for Traffic Signal Control"
    /// (RESCO), NeurIPS Datasets and Benchmarks 2021.
    pub delay_s: f64,
    /// Time below 0.1 m/s after entering, over all cars that entered.
    pub waiting_time_s: f64,
}

impl TripFile {
    pub fn new() -> Result<TripFile> {
        Ok(TripFile { file: tempfile::tempfile().context("no temporary file for SUMO's trips: set TMPDIR")? })
    }

    /// What makes SUMO write the trips, from the beginning of the file. Digits: as many as there are in a millisecond.
    pub fn options(&self) -> [String; 8] {
        let place = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        let on = || "true".to_owned();
        [
            "--tripinfo-output".to_owned(),
            place,
            "--tripinfo-output.write-unfinished".to_owned(),
            on(),
            "--tripinfo-output.write-undeparted".to_owned(),
            on(),
            "--precision".to_owned(),
            "6".to_owned(),
        ]
    }

    /// The trips that SUMO wrote; it writes those of the cars on the road when it closes the simulation.
    pub fn read(&mut self) -> Result<Trips> {
        self.file.rewind().context("SUMO's trips")?;
        read(&mut Reader::from_reader(BufReader::new(&self.file)))
    }

    #[cfg(test)]
    pub fn text(&mut self) -> String {
        self.file.rewind().expect("a file");
        std::io::read_to_string(&self.file).expect("text")
    }
}

fn read(reader: &mut Reader<impl std::io::BufRead>) -> Result<Trips> {
    let mut buffer = Vec::new();
    let (mut sums, mut cars, mut entered) = (Trips::default(), 0_u32, 0_u32);
    loop {
        buffer.clear();
        let tag = match reader.read_event_into(&mut buffer).context("SUMO's trips are not XML")? {
            Event::Start(tag) | Event::Empty(tag) if tag.name().as_ref() == b"tripinfo" => tag,
            Event::End(tag) if tag.name().as_ref() == b"tripinfos" => break,
            // A net that no car came near has an empty root.
            Event::Empty(tag) if tag.name().as_ref() == b"tripinfos" => break,
            Event::Eof => bail!("SUMO's trips end too early"),
            _ => continue,
        };
        let mut values = BTreeMap::new();
        for attribute in tag.attributes() {
            let attribute = attribute.context("SUMO's trips are not XML")?;
            values.insert(attribute.key.as_ref().to_vec(), attribute.value.into_owned());
        }
        let number = |name: &str| -> Result<f64> {
            let text = values.get(name.as_bytes()).map(|bytes| String::from_utf8_lossy(bytes));
            let number = text.as_deref().and_then(|text| text.parse().ok());
            number.with_context(|| format!("a trip of SUMO's has no number `{name}`"))
        };
        cars += 1;
        sums.delay_s += number("timeLoss")? + number("departDelay")?;
        // A car that never entered departs at -1.
        if number("depart")? >= 0.0 {
            entered += 1;
            sums.travel_time_s += number("duration")?;
            sums.waiting_time_s += number("waitingTime")?;
        }
    }
    let mean = |sum: f64, cars: u32| sum / f64::from(cars.max(1));
    Ok(Trips {
        travel_time_s: mean(sums.travel_time_s, entered),
        delay_s: mean(sums.delay_s, cars),
        waiting_time_s: mean(sums.waiting_time_s, entered),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cars_that_never_entered_count_in_the_delay_alone() {
        let text = r#"<?xml version="1.0"?><!-- by SUMO --><tripinfos>
            <tripinfo id="a" depart="3.0" departDelay="1.0" arrival="43.0" duration="40.0" waitingTime="5.0" timeLoss="7.5"/>
            <tripinfo id="b" depart="9.0" departDelay="0.0" arrival="-1.0" duration="20.0" waitingTime="1.0" timeLoss="2.5"/>
            <tripinfo id="c" depart="-1" departDelay="16.0" arrival="-1.0" duration="0.0" waitingTime="0.0" timeLoss="0.0"/>
            </tripinfos>"#;
        let trips = read(&mut Reader::from_reader(text.as_bytes())).unwrap();
        // (40 + 20) / 2; (7.5 + 1 + 2.5 + 16) / 3; (5 + 1) / 2
        assert_eq!(trips, Trips { travel_time_s: 30.0, delay_s: 9.0, waiting_time_s: 3.0 });
    }

    #[test]
    fn an_episode_without_cars_has_no_delay_and_a_torn_file_is_an_error() {
        let read = |text: &str| super::read(&mut Reader::from_reader(text.as_bytes()));
        assert_eq!(read("<tripinfos/>").unwrap(), Trips::default());
        assert!(read("<tripinfos><tripinfo id=\"a\"").is_err());
        assert!(read("<tripinfos>").unwrap_err().to_string().contains("end too early"));
        let error = read("<tripinfos><tripinfo depart=\"1\"/></tripinfos>").unwrap_err().to_string();
        assert_eq!(error, "a trip of SUMO's has no number `timeLoss`");
    }
}
