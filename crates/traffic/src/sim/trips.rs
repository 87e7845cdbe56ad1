//! The trips that SUMO writes at the end of an episode.

use anyhow::{Context, Result};
use roxmltree::{Document, Node};

/// One trip of SUMO's `tripinfo` output. Times are in seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Trip {
    pub(crate) car: String,
    pub(crate) vehicle_type: String,
    /// When the car entered; -1 if it never did.
    pub(crate) depart_s: f64,
    pub(crate) depart_delay_s: f64,
    pub(crate) duration_s: f64,
    pub(crate) loss_s: f64,
    pub(crate) waiting_s: f64,
    /// How often it came to a stand, but for stops of its plan.
    pub(crate) stops: f64,
    /// Whether SUMO took it off the road, and not because the episode was over.
    pub(crate) removed: bool,
    /// Mass of CO2 and of fuel in mg, if emissions are measured.
    pub(crate) emissions: Option<[f64; 2]>,
}

impl Trip {
    pub(crate) fn entered(&self) -> bool {
        self.depart_s >= 0.0
    }

    /// Returns when the car wanted to enter. No controller changes that. `end_s`: when the episode ended.
    pub(crate) fn wished_s(&self, end_s: f64) -> f64 {
        (if self.entered() { self.depart_s } else { end_s }) - self.depart_delay_s
    }

    /// Returns the time lost before and after entering.
    pub(crate) fn delay_s(&self) -> f64 {
        self.loss_s + self.depart_delay_s
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct AllTrips {
    pub(crate) cars: Vec<Trip>,
    pub(crate) persons: u64,
}

impl AllTrips {
    /// Reads SUMO's file of trips.
    pub(crate) fn read(text: &str) -> Result<AllTrips> {
        let document = Document::parse(text).context("SUMO's trips are not XML")?;
        let all = |name: &'static str| document.root_element().children().filter(move |node| node.has_tag_name(name));
        Ok(AllTrips {
            cars: all("tripinfo").map(read).collect::<Result<_>>()?,
            persons: all("personinfo").count() as u64,
        })
    }
}

fn read(trip: Node<'_, '_>) -> Result<Trip> {
    let text = |name: &str| trip.attribute(name).unwrap_or_default().to_owned();
    let emissions = trip.children().find(|node| node.has_tag_name("emissions"));
    let emissions = emissions.map(|node| Ok::<_, anyhow::Error>([number(node, "CO2_abs")?, number(node, "fuel_abs")?]));
    let depart_s = number(trip, "depart")?;
    // A car that never entered departs at -1, and has no such numbers in all versions.
    let of_entered = |name: &str| if depart_s >= 0.0 { number(trip, name) } else { Ok(0.0) };
    Ok(Trip {
        car: text("id"),
        vehicle_type: text("vType"),
        depart_s,
        loss_s: number(trip, "timeLoss")?,
        depart_delay_s: number(trip, "departDelay")?,
        duration_s: of_entered("duration")?,
        waiting_s: of_entered("waitingTime")?,
        stops: of_entered("waitingCount")?,
        // Those that are on the road at the end are vaporized, too.
        removed: trip.attribute("vaporized").is_some_and(|why| !["", "end"].contains(&why)),
        emissions: emissions.transpose()?,
    })
}

pub(crate) fn number(node: Node<'_, '_>, name: &str) -> Result<f64> {
    let number = node.attribute(name).and_then(|text| text.parse().ok()).filter(|number: &f64| number.is_finite());
    number.with_context(|| format!("a trip of SUMO's has no number `{name}`"))
}
