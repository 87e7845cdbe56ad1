//! What pictures of a film show besides roads: title, clock, the scale of speeds, and lights wide enough to see.

use super::letters::{ADVANCE, HEIGHT, dots};
use super::picture_file::Picture;

/// Height of the bands above and below the roads, and the gap at their ends.
const BAND: usize = 40;
const GAP: usize = 12;
/// Pixels of a dot of a letter.
pub(super) const DOT: usize = 2;
/// Pixels by which a light is made wider on each side. sumo-gui draws a line of a pixel at the end of a lane.
const LIGHT: usize = 3;
/// Colours in which sumo-gui draws red, yellow and green, and nothing else.
const LIGHTS: [[u8; 3]; 3] = [[255, 0, 0], [255, 255, 0], [0, 255, 0]];
const SCALE: usize = 160;
/// Colour of everything that is no road, as sumo-gui paints it, too.
pub(super) const PAPER: [u8; 3] = [245, 245, 245];
const INK: [u8; 3] = [30, 30, 30];

/// A colour and the speed that it stands for, in metres per second.
pub(super) type SpeedColour = ([u8; 3], u32);

/// Returns a picture of the roads with its captions. `second`: shown as a clock. `speeds`: from the slowest on.
pub(super) fn caption(roads: &Picture, title: &str, second: u64, speeds: &[SpeedColour]) -> Picture {
    let band = Picture::plain([roads.width, BAND], PAPER).pixels;
    let pixels = [&*band, &roads.pixels, &band].concat();
    let mut picture = Picture { width: roads.width, height: roads.height + 2 * BAND, pixels };
    for (at, colour) in roads.colours().enumerate() {
        if let Some(&light) = LIGHTS.iter().find(|light| *light == colour) {
            let (x, y) = (at % roads.width, BAND + at / roads.width);
            picture.paint([x.saturating_sub(LIGHT), y.saturating_sub(LIGHT)], [2 * LIGHT + 1; 2], light);
        }
    }
    let clock = clock(second);
    let middle = (BAND - HEIGHT * DOT) / 2;
    let clock_x = roads.width.saturating_sub(GAP + width(&clock));
    write_text(&mut picture, &fitting(title, clock_x.saturating_sub(2 * GAP)), [GAP, middle], INK);
    write_text(&mut picture, &clock, [clock_x, middle], INK);
    scale(&mut picture, speeds, BAND + roads.height);
    picture
}

/// Draws a bar with the colours of all speeds into the band that begins at this row.
fn scale(picture: &mut Picture, speeds: &[SpeedColour], band: usize) {
    let [Some(&(_, slowest)), Some(&(_, fastest))] = [speeds.first(), speeds.last()] else { return };
    let middle = band + (BAND - HEIGHT * DOT) / 2;
    let label = format!("speed of cars (m/s): {slowest}");
    write_text(picture, &label, [GAP, middle], INK);
    let begin = GAP + width(&label) + GAP;
    for x in 0..SCALE {
        let speed = slowest as f32 + (fastest - slowest) as f32 * x as f32 / SCALE as f32;
        picture.paint([begin + x, middle], [1, HEIGHT * DOT], between(speeds, speed));
    }
    write_text(picture, &fastest.to_string(), [begin + SCALE + GAP, middle], INK);
}

/// Returns the colour of a speed between two of the scale.
fn between(speeds: &[SpeedColour], speed: f32) -> [u8; 3] {
    let pair = speeds.windows(2).find(|pair| speed <= pair[1].1 as f32);
    let Some(&[(slow, from), (fast, to)]) = pair else { return speeds[speeds.len() - 1].0 };
    let share = (speed - from as f32) / (to - from) as f32;
    std::array::from_fn(|part| (f32::from(slow[part]) * (1.0 - share) + f32::from(fast[part]) * share) as u8)
}

fn clock(second: u64) -> String {
    format!("{}:{:02}:{:02}", second / 3600, second / 60 % 60, second % 60)
}

fn width(text: &str) -> usize {
    text.chars().count() * ADVANCE * DOT
}

/// Returns a text that is at most this wide; dots stand for its end.
fn fitting(text: &str, most: usize) -> String {
    if width(text) <= most {
        return text.to_owned();
    }
    let letters = (most / (ADVANCE * DOT)).saturating_sub(3);
    text.chars().take(letters).chain("...".chars()).collect()
}

pub(super) fn write_text(picture: &mut Picture, text: &str, [x, y]: [usize; 2], colour: [u8; 3]) {
    dots(text).for_each(|(column, row)| picture.paint([x + column * DOT, y + row * DOT], [DOT; 2], colour));
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEEDS: [SpeedColour; 3] = [([200, 0, 0], 0), ([200, 200, 0], 5), ([0, 0, 200], 10)];

    fn count(picture: &Picture, rows: std::ops::Range<usize>, colour: [u8; 3]) -> usize {
        let pixels = picture.colours().skip(rows.start * picture.width).take(rows.len() * picture.width);
        pixels.filter(|&pixel| pixel == colour).count()
    }

    #[test]
    fn a_light_of_a_pixel_becomes_a_square_and_roads_stay_as_they_are() {
        let mut roads = Picture::plain([400, 100], [90; 3]);
        roads.paint([50, 20], [1, 1], [0, 255, 0]);
        let picture = caption(&roads, "a", 0, &SPEEDS);
        assert_eq!((picture.width, picture.height), (400, 180));
        assert_eq!(count(&picture, 40..140, [0, 255, 0]), 49);
        assert_eq!(picture.colours().position(|pixel| pixel == [0, 255, 0]), Some(57 * 400 + 47));
        assert_eq!(count(&picture, 40..140, [90, 90, 90]), 400 * 100 - 49);
    }

    #[test]
    fn the_title_and_the_clock_are_above_and_the_speeds_below() {
        let roads = Picture::plain([400, 100], [90; 3]);
        let ink = |title: &str| count(&caption(&roads, title, 0, &SPEEDS), 0..40, INK);
        // Each dot has four pixels. A colon has eight dots, and a zero has 19.
        let zeros = 4 * (5 * 19 + 2 * 8);
        assert_eq!((ink(""), ink("-")), (zeros, zeros + 4 * 5));
        assert_eq!(clock(3671), "1:01:11");
        let picture = caption(&roads, "", 0, &SPEEDS);
        for (colour, _) in [SPEEDS[0], SPEEDS[1]] {
            assert_eq!(count(&picture, 140..180, colour), HEIGHT * DOT, "one column has exactly this colour");
        }
    }

    #[test]
    fn captions_fit_into_any_picture() {
        let picture = caption(&Picture::plain([1, 1], PAPER), "policies", 0, &SPEEDS);
        assert_eq!((picture.width, picture.height), (1, 1 + 2 * BAND));
        assert_eq!(fitting("policies", 8 * ADVANCE * DOT), "policies");
        assert_eq!(fitting("policies", 8 * ADVANCE * DOT - 1), "poli...");
    }
}
