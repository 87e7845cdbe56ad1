//! SUMO's own data on every car's trip: its tripinfo output, read when an episode is over.

use std::fs::File;
use std::io::{Read, Seek};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result};
use roxmltree::{Document, Node};

use dials_core::outside::temporary_file;

/// The file to which SUMO writes the trips of an episode. It has no name, so a killed process leaves none behind.
pub(crate) struct TripFile {
    file: File,
}

/// Means over the trips of an episode, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Trips {
    /// Travel time from entering the net to leaving it or to the end of the episode. The mean is over all cars that
    /// entered.
    pub(crate) travel_time_s: f64,
    /// Time lost by driving slower than allowed and by waiting at the boundary before entering. The mean is over all
    /// cars, including those that never entered. Source: Ault and Sharon, "Reinforcement Learning Benchmarks for
    /// Traffic Signal Control" (RESCO), NeurIPS Datasets and Benchmarks 2021.
    pub(crate) delay_s: f64,
    /// Time below 0.1 m/s after entering. The mean is over all cars that entered.
    pub(crate) waiting_time_s: f64,
}

impl TripFile {
    pub(super) fn new() -> Result<TripFile> {
        Ok(TripFile { file: temporary_file().context("SUMO's trips have no place")? })
    }

    /// Returns the options that make SUMO write the trips, from the beginning of the file, with the digits of a
    /// millisecond.
    pub(super) fn options(&self) -> [String; 8] {
        let place = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        [
            "--tripinfo-output",
            &place,
            "--tripinfo-output.write-unfinished",
            "true",
            "--tripinfo-output.write-undeparted",
            "true",
            "--precision",
            "6",
        ]
        .map(str::to_owned)
    }

    /// Returns the means of the trips that SUMO wrote. SUMO writes those of the cars on the road when it closes the
    /// simulation.
    pub(super) fn read(&mut self) -> Result<Trips> {
        means(&self.text()?)
    }

    /// Returns what SUMO wrote.
    pub(super) fn text(&mut self) -> Result<String> {
        let mut text = String::new();
        self.file
            .rewind()
            .and_then(|()| self.file.read_to_string(&mut text))
            .context("SUMO's trips could not be read")?;
        Ok(text)
    }
}

fn means(text: &str) -> Result<Trips> {
    let document = Document::parse(text).context("SUMO's trips are not XML")?;
    let (mut sums, mut cars, mut entered) = (Trips::default(), 0_u32, 0_u32);
    for trip in document.root_element().children().filter(|node| node.has_tag_name("tripinfo")) {
        cars += 1;
        sums.delay_s += number(trip, "timeLoss")? + number(trip, "departDelay")?;
        // A car that never entered departs at -1.
        if number(trip, "depart")? >= 0.0 {
            entered += 1;
            sums.travel_time_s += number(trip, "duration")?;
            sums.waiting_time_s += number(trip, "waitingTime")?;
        }
    }
    Ok(Trips {
        travel_time_s: mean(sums.travel_time_s, entered),
        delay_s: mean(sums.delay_s, cars),
        waiting_time_s: mean(sums.waiting_time_s, entered),
    })
}

fn number(trip: Node<'_, '_>, name: &str) -> Result<f64> {
    let number = trip.attribute(name).and_then(|text| text.parse().ok()).filter(|number: &f64| number.is_finite());
    number.with_context(|| format!("a trip of SUMO's has no number `{name}`"))
}

/// Returns the mean; 0 if there are no cars.
fn mean(sum: f64, cars: u32) -> f64 {
    sum / f64::from(cars.max(1))
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
        let trips = means(text).unwrap();
        // (40 + 20) / 2; (7.5 + 1 + 2.5 + 16) / 3; (5 + 1) / 2
        assert_eq!(trips, Trips { travel_time_s: 30.0, delay_s: 9.0, waiting_time_s: 3.0 });
    }

    #[test]
    fn an_episode_without_cars_has_no_delay_and_a_torn_file_is_an_error() {
        assert_eq!(means("<tripinfos/>").unwrap(), Trips::default());
        assert!(means("<tripinfos><tripinfo id=\"a\"").is_err());
        assert_eq!(means("<tripinfos>").unwrap_err().to_string(), "SUMO's trips are not XML");
        let error = means("<tripinfos><tripinfo depart=\"1\"/></tripinfos>").unwrap_err().to_string();
        assert_eq!(error, "a trip of SUMO's has no number `timeLoss`");
        for odd in ["nan", "inf", "-inf", "", "1e999"] {
            let text = format!("<tripinfos><tripinfo depart=\"1\" timeLoss=\"{odd}\" departDelay=\"0\"/></tripinfos>");
            assert_eq!(means(&text).unwrap_err().to_string(), error, "{odd}");
        }
    }
}
