//! The vehicle types that SUMO has by itself, and their classes.

/// Type of vehicles that name none.
pub(crate) const USUAL_TYPE: &str = "DEFAULT_VEHTYPE";

/// Class of vehicles whose type names none.
pub(crate) const USUAL_CLASS: &str = "passenger";

/// The types with the classes of those who have them.
pub(super) const OWN_TYPES: [(&str, &str); 6] = [
    (USUAL_TYPE, USUAL_CLASS),
    ("DEFAULT_BIKETYPE", "bicycle"),
    ("DEFAULT_TAXITYPE", "taxi"),
    ("DEFAULT_RAILTYPE", "rail"),
    ("DEFAULT_PEDTYPE", "pedestrian"),
    ("DEFAULT_CONTAINERTYPE", "pedestrian"),
];
