//! The four sides of an intersection. Their order is defined here and nowhere else.

/// A side of an intersection, seen from its middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    West,
    South,
    East,
    North,
}

impl Side {
    /// Order of observations, influence sources and every array with one entry per side (the authors' setup).
    pub const ALL: [Side; 4] = [Side::West, Side::South, Side::East, Side::North];

    /// Order of the links of an intersection: the reverse of [`Side::ALL`] (the authors' setup).
    ///
    /// The letters of a light's state and netconvert's numbers of the lanes inside an intersection are in this order.
    pub(crate) const LINK_ORDER: [Side; 4] = {
        let [first, second, third, fourth] = Side::ALL;
        [fourth, third, second, first]
    };

    /// Ends of the road from west to east.
    pub(crate) const HORIZONTAL: [Side; 2] = [Side::West, Side::East];
    /// Ends of the road from south to north.
    pub(crate) const VERTICAL: [Side; 2] = [Side::South, Side::North];

    pub fn index(self) -> usize {
        self as usize
    }

    pub(crate) fn link_index(self) -> usize {
        Side::ALL.len() - 1 - self.index()
    }

    pub(crate) fn is_vertical(self) -> bool {
        Side::VERTICAL.contains(&self)
    }

    pub(crate) fn opposite(self) -> Side {
        match self {
            Side::West => Side::East,
            Side::South => Side::North,
            Side::East => Side::West,
            Side::North => Side::South,
        }
    }

    /// Returns its name. Names of boundary nodes begin with its first letter.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Side::West => "west",
            Side::South => "south",
            Side::East => "east",
            Side::North => "north",
        }
    }
}
