//! Reads and writes the pictures of a film, which are PNG files.

use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::Path;

use anyhow::{Context, Result, ensure};

pub(super) struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Four bytes for each pixel, row by row: red, green, blue and opacity.
    pub(super) pixels: Vec<u8>,
}

impl Picture {
    pub(super) fn plain([width, height]: [usize; 2], [red, green, blue]: [u8; 3]) -> Picture {
        Picture { width, height, pixels: [red, green, blue, 255].repeat(width * height) }
    }

    pub(super) fn size(path: &Path) -> Result<[usize; 2]> {
        let reader = open(path)?;
        Ok([reader.info().width as usize, reader.info().height as usize])
    }

    pub(super) fn read(path: &Path) -> Result<Picture> {
        let failed = || no_picture(path);
        let mut reader = open(path)?;
        let mut pixels = vec![0; reader.output_buffer_size().with_context(failed)?];
        let info = reader.next_frame(&mut pixels).with_context(failed)?;
        ensure!(info.color_type == png::ColorType::Rgba, "{}: is not in colour", path.display());
        Ok(Picture { width: info.width as usize, height: info.height as usize, pixels })
    }

    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let failed = || format!("{}: the picture cannot be written", path.display());
        let file = BufWriter::new(File::create(path).with_context(failed)?);
        let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header().with_context(failed)?;
        writer.write_image_data(&self.pixels).with_context(failed)?;
        writer.finish().with_context(failed)
    }

    /// Returns the colours of all pixels, each as red, green and blue.
    pub(super) fn colours(&self) -> impl Iterator<Item = &[u8]> {
        self.pixels.chunks_exact(4).map(|pixel| &pixel[..3])
    }

    /// Paints a rectangle. What is outside of the picture is left out.
    pub(super) fn paint(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], [red, green, blue]: [u8; 3]) {
        for row in y..(y + height).min(self.height) {
            for column in x..(x + width).min(self.width) {
                let at = 4 * (row * self.width + column);
                self.pixels[at..at + 4].copy_from_slice(&[red, green, blue, 255]);
            }
        }
    }
}

fn open(path: &Path) -> Result<png::Reader<BufReader<File>>> {
    let failed = || no_picture(path);
    let file = BufReader::new(File::open(path).with_context(failed)?);
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::ALPHA | png::Transformations::STRIP_16);
    decoder.read_info().with_context(failed)
}

fn no_picture(path: &Path) -> String {
    format!("{}: is not a picture that sumo-gui writes", path.display())
}
