//! Pictures of a simulator: flat shapes that become SVG or pixels.

use std::fmt::Write;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Colour(pub [u8; 3]);

/// Height of a line of text in an SVG file, in pixels.
const LINE_PX: f32 = 24.0;

/// Shapes on a plane, painted one over the other. Units are the domain's own (warehouse: cells).
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    width: f32,
    height: f32,
    background: Colour,
    shapes: Vec<(SceneShape, Colour)>,
    /// What a colour means. Only an SVG file shows it.
    legend: Vec<(Colour, &'static str)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SceneShape {
    Rectangle { x: f32, y: f32, width: f32, height: f32 },
    Disc { x: f32, y: f32, radius: f32 },
    Line { from: [f32; 2], to: [f32; 2], width: f32 },
}

impl SceneShape {
    fn covers(self, px: f32, py: f32) -> bool {
        match self {
            SceneShape::Rectangle { x, y, width, height } => {
                (x..x + width).contains(&px) && (y..y + height).contains(&py)
            }
            SceneShape::Disc { x, y, radius } => (px - x).powi(2) + (py - y).powi(2) <= radius * radius,
            SceneShape::Line { from, to, width } => {
                let along = [to[0] - from[0], to[1] - from[1]];
                let length = along[0].hypot(along[1]).max(f32::MIN_POSITIVE);
                let (dx, dy) = (px - from[0], py - from[1]);
                let ahead = (dx * along[0] + dy * along[1]) / length;
                let aside = (dx * along[1] - dy * along[0]) / length;
                (0.0..=length).contains(&ahead) && aside.abs() <= width / 2.0
            }
        }
    }

    fn bounds(self) -> [f32; 4] {
        match self {
            SceneShape::Rectangle { x, y, width, height } => [x, y, x + width, y + height],
            SceneShape::Disc { x, y, radius } => [x - radius, y - radius, x + radius, y + radius],
            SceneShape::Line { from, to, width } => {
                let [left, top] = [0, 1].map(|i: usize| from[i].min(to[i]) - width / 2.0);
                let [right, bottom] = [0, 1].map(|i: usize| from[i].max(to[i]) + width / 2.0);
                [left, top, right, bottom]
            }
        }
    }
}

impl Scene {
    pub fn new(width: f32, height: f32, background: Colour) -> Self {
        Scene { width, height, background, shapes: Vec::new(), legend: Vec::new() }
    }

    pub fn size(&self) -> [f32; 2] {
        [self.width, self.height]
    }

    /// Adds a line to the legend.
    pub fn explain(&mut self, colour: Colour, words: &'static str) {
        self.legend.push((colour, words));
    }

    pub fn rectangle(&mut self, x: f32, y: f32, width: f32, height: f32, colour: Colour) {
        self.shapes.push((SceneShape::Rectangle { x, y, width, height }, colour));
    }

    pub fn disc(&mut self, x: f32, y: f32, radius: f32, colour: Colour) {
        self.shapes.push((SceneShape::Disc { x, y, radius }, colour));
    }

    /// Draws a straight line with flat ends.
    pub fn line(&mut self, from: [f32; 2], to: [f32; 2], width: f32, colour: Colour) {
        self.shapes.push((SceneShape::Line { from, to, width }, colour));
    }

    /// Returns the picture as an SVG file, `scale` pixels per unit, with a title above and the legend below. `title`: text
    /// without characters that XML escapes.
    pub fn to_svg(&self, scale: f32, title: &str) -> String {
        let hex = |Colour([r, g, b]): Colour| format!("#{r:02x}{g:02x}{b:02x}");
        let (width, height) = (self.width, self.height);
        // A line of text, in units of the scene.
        let line = LINE_PX / scale;
        let whole = height + line * (1 + self.legend.len()) as f32;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 {} {width} {whole}\" \
             font-family=\"sans-serif\" font-size=\"{}\">\n\
             <rect y=\"{}\" width=\"{width}\" height=\"{whole}\" fill=\"#fefefe\"/>\n\
             <text x=\"{}\" y=\"{}\">{title}</text>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>\n",
            width * scale,
            whole * scale,
            -line,
            0.6 * line,
            -line,
            0.3 * line,
            -0.3 * line,
            hex(self.background)
        );
        for (number, &(colour, words)) in self.legend.iter().enumerate() {
            let top = height + line * number as f32;
            let (x, y, side, fill) = (0.3 * line, top + 0.25 * line, 0.5 * line, hex(colour));
            let (words_x, words_y) = (1.2 * line, top + 0.7 * line);
            let written = writeln!(
                svg,
                "<rect x=\"{x}\" y=\"{y}\" width=\"{side}\" height=\"{side}\" fill=\"{fill}\"/>\
                 <text x=\"{words_x}\" y=\"{words_y}\">{words}</text>"
            );
            written.expect("a string takes everything");
        }
        for &(shape, colour) in &self.shapes {
            let fill = hex(colour);
            let written = match shape {
                SceneShape::Rectangle { x, y, width, height } => {
                    writeln!(svg, "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{fill}\"/>")
                }
                SceneShape::Disc { x, y, radius } => {
                    writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"{fill}\"/>")
                }
                SceneShape::Line { from: [x1, y1], to: [x2, y2], width } => writeln!(
                    svg,
                    "<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\" stroke=\"{fill}\" stroke-width=\"{width}\"/>"
                ),
            };
            written.expect("a string takes everything");
        }
        svg.push_str("</svg>\n");
        svg
    }

    /// Returns the picture as pixels, row-major, `scale` per unit: `(width, height, colours)`.
    pub fn to_pixels(&self, scale: usize) -> (usize, usize, Vec<Colour>) {
        let size = |length: f32| (length * scale as f32).ceil() as usize;
        let (width, height) = (size(self.width), size(self.height));
        let mut pixels = vec![self.background; width * height];
        let unit = |pixel: usize| (pixel as f32 + 0.5) / scale as f32;
        for &(shape, colour) in &self.shapes {
            let [left, top, right, bottom] = shape.bounds();
            for y in (top.max(0.0) * scale as f32) as usize..size(bottom).min(height) {
                for x in (left.max(0.0) * scale as f32) as usize..size(right).min(width) {
                    if shape.covers(unit(x), unit(y)) {
                        pixels[y * width + x] = colour;
                    }
                }
            }
        }
        (width, height, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: Colour = Colour([255; 3]);
    const RED: Colour = Colour([255, 0, 0]);

    /// Returns the red ones of the pixels.
    fn red((_, _, pixels): (usize, usize, Vec<Colour>)) -> Vec<usize> {
        (0..pixels.len()).filter(|&pixel| pixels[pixel] == RED).collect()
    }

    #[test]
    fn later_shapes_cover_earlier_ones() {
        let mut scene = Scene::new(2.0, 1.0, WHITE);
        scene.rectangle(0.0, 0.0, 1.0, 1.0, Colour([0; 3]));
        scene.rectangle(0.5, 0.0, 1.0, 1.0, RED);
        assert_eq!(scene.to_pixels(2).2[..4], [Colour([0; 3]), RED, RED, WHITE]);
    }

    #[test]
    fn svg_and_pixels_show_the_same_shapes_and_an_svg_has_a_title_and_a_legend() {
        let mut line = Scene::new(4.0, 4.0, WHITE);
        line.line([0.0, 0.0], [4.0, 4.0], 0.5, RED);
        let svg = line.to_svg(10.0, "a line");
        assert!(svg.contains("<line x1=\"0\" y1=\"0\" x2=\"4\" y2=\"4\" stroke=\"#ff0000\" stroke-width=\"0.5\"/>"));
        // The middles of the other pixels are at least 0.7 away from the diagonal.
        assert_eq!(red(line.to_pixels(1)), [0, 5, 10, 15]);
        let mut disc = Scene::new(3.0, 3.0, WHITE);
        disc.disc(1.5, 1.5, 0.6, RED);
        disc.explain(RED, "a fire");
        let svg = disc.to_svg(24.0, "step 7");
        assert!(svg.contains("<circle cx=\"1.5\" cy=\"1.5\" r=\"0.6\" fill=\"#ff0000\"/>"), "{svg}");
        assert_eq!(red(disc.to_pixels(1)), [4]);
        // A line is one unit high here: one above for the title, one below for the legend.
        assert!(svg.contains("viewBox=\"0 -1 3 5\"") && svg.contains(">step 7</text>"), "{svg}");
        assert!(svg.contains("fill=\"#ff0000\"/><text x=\"1.2\" y=\"3.7\">a fire</text>"), "{svg}");
    }
}
