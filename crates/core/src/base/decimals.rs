//! How many digits after the point a printed figure needs.

/// Most digits after the point.
const MOST: f64 = 4.0;

/// Returns the number of digits after the point of a figure and of the half-width of its interval, if that is known.
///
/// Returns of traffic on the paper's grids, from 50 on, have one. Smaller figures have two, and more if two digits of
/// the half-width would not be seen otherwise. Figures below 5 without an interval have three.
pub fn decimals(figure: f64, half_width: Option<f64>) -> usize {
    let size = figure.abs();
    match half_width {
        _ if size >= 50.0 => 1,
        Some(half_width) if half_width > 0.0 => (1.0 - half_width.log10().floor()).clamp(2.0, MOST) as usize,
        // Counts that are the same in all episodes need no more.
        Some(0.0) => 2,
        _ if 0.0 < size && size < 5.0 => 3,
        _ => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_figures_have_more_digits_and_those_near_200_have_one() {
        assert_eq!([217.44, -60.0, 13.09, -1.04, 0.0].map(|figure| decimals(figure, None)), [1, 1, 2, 3, 2]);
        assert_eq!(decimals(217.44, Some(0.01)), 1);
        // Two digits of the half-width: 2.3, 0.11, 0.012, 0.0012, and no more than four.
        let widths = [2.3, 0.11, 0.012, 0.0012, 0.00012];
        assert_eq!(widths.map(|width| decimals(-1.04, Some(width))), [2, 2, 3, 4, 4]);
        assert_eq!([0.0, f64::NAN, f64::INFINITY].map(|width| decimals(-1.04, Some(width))), [2, 3, 2]);
    }
}
