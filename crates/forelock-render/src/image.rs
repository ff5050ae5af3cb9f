//! 8-bit pictures and their encoding as PNG and JPEG.

use std::io::Write;

/// The largest width and height of a picture, in pixels.
pub const MAX_SIDE: u32 = 4096;

/// Quality of JPEG pictures, 1 to 100.
const JPEG_QUALITY: u8 = 88;

/// Why a picture, a contact sheet or a film cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A width or height is 0 or over the limit.
    #[error("a picture of {width}×{height} pixels is outside 1×1 to {max}×{max}", max = MAX_SIDE)]
    Size {
        /// The requested width, pixels.
        width: u32,
        /// The requested height, pixels.
        height: u32,
    },
    /// The number of bytes is not width × height × 4.
    #[error("a picture of {width}×{height} pixels takes {expected} bytes, but {found} were given")]
    Bytes {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// The number of bytes expected.
        expected: usize,
        /// The number of bytes given.
        found: usize,
    },
    /// A contact sheet without pictures.
    #[error("a contact sheet needs at least one picture")]
    NoPictures,
    /// A frame whose size differs from that of the film.
    #[error("a frame of {}×{} pixels in a film of {}×{}", frame[0], frame[1], film[0], film[1])]
    FrameSize {
        /// The width and height of the frame.
        frame: [u32; 2],
        /// The width and height of the film.
        film: [u32; 2],
    },
    /// A film without frames, or with more than the format allows.
    #[error("a film of {0} frames: it needs at least one and fewer than 2³⁰")]
    FrameCount(u32),
    /// A frame rate of 0 or over 1000.
    #[error("a film at {0} frames per second: choose 1 to 1000")]
    FrameRate(u32),
    /// The PNG encoder failed.
    #[error("the PNG encoder failed")]
    Encoding(#[from] png::EncodingError),
    /// The JPEG encoder failed.
    #[error("the JPEG encoder failed")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
    /// Writing failed.
    #[error("writing the picture failed")]
    Io(#[from] std::io::Error),
}

/// A picture. Rows go from top to bottom. A pixel is 4 bytes: red, green and blue in sRGB, and
/// straight alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: u32,
    height: u32,
    rgba: Vec<u8>,
}

impl Image {
    /// A picture of one colour.
    ///
    /// # Errors
    /// [`ImageError::Size`] if a side is 0 or over [`MAX_SIDE`].
    pub fn filled(width: u32, height: u32, rgba: [u8; 4]) -> Result<Self, ImageError> {
        check_size(width, height)?;
        Ok(Self { width, height, rgba: rgba.repeat(width as usize * height as usize) })
    }

    /// A picture with the bytes `rgba`, `[height × width × 4]`.
    ///
    /// # Errors
    /// [`ImageError::Size`] or [`ImageError::Bytes`].
    pub fn from_rgba(width: u32, height: u32, rgba: Vec<u8>) -> Result<Self, ImageError> {
        check_size(width, height)?;
        let expected = width as usize * height as usize * 4;
        if rgba.len() != expected {
            return Err(ImageError::Bytes { width, height, expected, found: rgba.len() });
        }
        Ok(Self { width, height, rgba })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All bytes, `[height × width × 4]`.
    pub fn rgba(&self) -> &[u8] {
        &self.rgba
    }

    /// The pixel at column `x`, row `y`.
    ///
    /// # Panics
    /// If the pixel is outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 4] {
        let p = &self.rgba[self.offset(x, y)..][..4];
        [p[0], p[1], p[2], p[3]]
    }

    /// Copies `other` into this picture, with its upper left corner at (`x`, `y`). Parts outside
    /// are clipped.
    pub fn paste(&mut self, other: &Self, x: u32, y: u32) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = other.offset(0, row);
            let to = self.offset(x, y + row);
            let bytes = columns as usize * 4;
            self.rgba[to..to + bytes].copy_from_slice(&other.rgba[from..from + bytes]);
        }
    }

    /// Writes the picture as a PNG. The alpha channel is left out if all pixels are opaque.
    ///
    /// # Errors
    /// [`ImageError::Encoding`], also for errors of the writer.
    pub fn write_png(&self, writer: impl Write) -> Result<(), ImageError> {
        let opaque = self.rgba.chunks_exact(4).all(|p| p[3] == 255);
        let mut encoder = png::Encoder::new(writer, self.width, self.height);
        encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::Balanced);
        let mut writer = encoder.write_header()?;
        if opaque {
            let rgb: Vec<u8> = self.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
            writer.write_image_data(&rgb)?;
        } else {
            writer.write_image_data(&self.rgba)?;
        }
        writer.finish()?;
        Ok(())
    }

    /// The bytes of the picture as a PNG.
    ///
    /// # Errors
    /// The same errors as [`write_png`](Self::write_png).
    pub fn to_png(&self) -> Result<Vec<u8>, ImageError> {
        let mut bytes = Vec::new();
        self.write_png(&mut bytes)?;
        Ok(bytes)
    }

    /// The bytes of the picture as a JPEG of high quality, over black where it is transparent.
    ///
    /// # Errors
    /// [`ImageError::Jpeg`].
    pub fn to_jpeg(&self) -> Result<Vec<u8>, ImageError> {
        let over_black = |p: &[u8]| [0, 1, 2].map(|i| (u16::from(p[i]) * u16::from(p[3]) / 255) as u8);
        let rgb: Vec<u8> = self.rgba.chunks_exact(4).flat_map(over_black).collect();
        let mut bytes = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut bytes, JPEG_QUALITY);
        // No side of a picture is longer than `MAX_SIDE`.
        encoder.encode(&rgb, self.width as u16, self.height as u16, jpeg_encoder::ColorType::Rgb)?;
        Ok(bytes)
    }

    pub(crate) fn set_pixel(&mut self, x: u32, y: u32, rgba: [u8; 4]) {
        if x < self.width && y < self.height {
            let at = self.offset(x, y);
            self.rgba[at..at + 4].copy_from_slice(&rgba);
        }
    }

    pub(crate) fn offset(&self, x: u32, y: u32) -> usize {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {}×{}", self.width, self.height);
        (y as usize * self.width as usize + x as usize) * 4
    }
}

pub(crate) fn check_size(width: u32, height: u32) -> Result<(), ImageError> {
    let fits = |side: u32| (1..=MAX_SIDE).contains(&side);
    if fits(width) && fits(height) { Ok(()) } else { Err(ImageError::Size { width, height }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_decodes_back() {
        for alpha in [255, 90] {
            let rgba: Vec<u8> =
                (0..5 * 3).flat_map(|i| [i as u8 * 16, 255 - i as u8, i as u8, alpha]).collect();
            let image = Image::from_rgba(5, 3, rgba).unwrap();
            let mut decoder = png::Decoder::new(std::io::Cursor::new(image.to_png().unwrap()));
            decoder.set_transformations(png::Transformations::ALPHA);
            let mut reader = decoder.read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut bytes).unwrap();
            assert_eq!((info.width, info.height), (5, 3));
            assert_eq!(bytes, image.rgba());
        }
    }

    #[test]
    fn sizes_have_limits() {
        assert!(Image::filled(1, 1, [0; 4]).is_ok());
        assert!(matches!(Image::filled(0, 4, [0; 4]), Err(ImageError::Size { .. })));
        assert!(matches!(Image::filled(4, MAX_SIDE + 1, [0; 4]), Err(ImageError::Size { .. })));
        assert!(matches!(Image::from_rgba(2, 2, vec![0; 15]), Err(ImageError::Bytes { .. })));
    }

    #[test]
    fn paste_cuts_at_the_border() {
        let mut image = Image::filled(4, 4, [0, 0, 0, 255]).unwrap();
        image.paste(&Image::filled(3, 3, [9, 9, 9, 255]).unwrap(), 2, 3);
        assert_eq!(image.pixel(3, 3), [9, 9, 9, 255]);
        assert_eq!(image.pixel(1, 3), [0, 0, 0, 255]);
        assert_eq!(image.pixel(3, 2), [0, 0, 0, 255]);
    }
}
