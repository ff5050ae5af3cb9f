//! Films as animated PNGs, written frame by frame.
//!
//! # Practice
//! The first frame is a complete picture, which programs without animation show. Each later frame
//! stores only the smallest rectangle that changed. Inside it, unchanged pixels are transparent and
//! the frame is blended over the previous one, which compresses far better than repeating them.
//! Colours are stored without a palette. The number of frames is written when the film is finished,
//! so the writer must be able to seek. Memory holds one frame, whatever the length of the film.
//!
//! Layout: PNG specification, third edition (W3C 2025), chunks `acTL`, `fcTL` and `fdAT`. The `png`
//! crate compresses the pixels. This module writes the chunks around them, because the encoder of
//! that crate must know the number of frames in advance.

use std::io::{Seek, SeekFrom, Write};

use crate::image::{Image, ImageError, check_size};

const SIGNATURE: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];
/// The offset of the chunk with the number of frames: after the signature and the header chunk.
const FRAME_COUNT_AT: u64 = 8 + 25;

/// A film that is being written.
#[derive(Debug)]
pub struct Film<W: Write + Seek> {
    writer: W,
    start: u64,
    size: [u32; 2],
    fps: u16,
    frames: u32,
    /// The sequence number of the next animation chunk.
    sequence: u32,
    /// The picture that a viewer shows after the frames so far.
    shown: Vec<u8>,
}

/// A rectangle of a frame, in pixels.
#[derive(Clone, Copy)]
struct Rect {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl<W: Write + Seek> Film<W> {
    /// Starts a film of `width` × `height` pixels at `fps` frames per second, which plays in an
    /// endless loop. It is written at the current position of `writer`.
    ///
    /// # Errors
    /// [`ImageError::Size`], [`ImageError::FrameRate`] or [`ImageError::Io`].
    pub fn new(mut writer: W, width: u32, height: u32, fps: u32) -> Result<Self, ImageError> {
        check_size(width, height)?;
        let fps =
            u16::try_from(fps).ok().filter(|f| (1..=1000).contains(f)).ok_or(ImageError::FrameRate(fps))?;
        let start = writer.stream_position()?;
        let mut header = Vec::with_capacity(13);
        header.extend(width.to_be_bytes());
        header.extend(height.to_be_bytes());
        // 8 bits, RGBA, deflate, adaptive filters, not interlaced.
        header.extend([8, 6, 0, 0, 0]);
        writer.write_all(&SIGNATURE)?;
        write_chunk(&mut writer, *b"IHDR", &header)?;
        write_chunk(&mut writer, *b"acTL", &[0; 8])?;
        write_chunk(&mut writer, *b"sRGB", &[0])?;
        Ok(Self { writer, start, size: [width, height], fps, frames: 0, sequence: 0, shown: Vec::new() })
    }

    /// Adds a frame. Its alpha channel is ignored.
    ///
    /// # Errors
    /// [`ImageError::FrameSize`], [`ImageError::FrameCount`], [`ImageError::Encoding`] or
    /// [`ImageError::Io`].
    pub fn push(&mut self, frame: &Image) -> Result<(), ImageError> {
        let size = [frame.width(), frame.height()];
        if size != self.size {
            return Err(ImageError::FrameSize { frame: size, film: self.size });
        }
        if self.sequence > u32::MAX / 2 - 2 {
            return Err(ImageError::FrameCount(self.frames));
        }
        let first = self.frames == 0;
        let (rect, pixels) = if first {
            self.shown = frame.rgba().to_vec();
            self.shown.chunks_exact_mut(4).for_each(|p| p[3] = 255);
            (Rect { x: 0, y: 0, width: size[0], height: size[1] }, self.shown.clone())
        } else {
            self.difference(frame)
        };
        self.write_frame_control(rect, !first)?;
        for data in packed(&pixels, rect)? {
            if first {
                write_chunk(&mut self.writer, *b"IDAT", &data)?;
            } else {
                let mut numbered = self.sequence.to_be_bytes().to_vec();
                numbered.extend(data);
                write_chunk(&mut self.writer, *b"fdAT", &numbered)?;
                self.sequence += 1;
            }
        }
        self.frames += 1;
        Ok(())
    }

    /// Completes the film and returns the writer, positioned after the film.
    ///
    /// # Errors
    /// [`ImageError::FrameCount`] for a film without frames, or [`ImageError::Io`].
    pub fn finish(mut self) -> Result<W, ImageError> {
        if self.frames == 0 {
            return Err(ImageError::FrameCount(0));
        }
        write_chunk(&mut self.writer, *b"IEND", &[])?;
        let end = self.writer.stream_position()?;
        self.writer.seek(SeekFrom::Start(self.start + FRAME_COUNT_AT))?;
        let mut control = self.frames.to_be_bytes().to_vec();
        control.extend([0; 4]);
        write_chunk(&mut self.writer, *b"acTL", &control)?;
        self.writer.seek(SeekFrom::Start(end))?;
        self.writer.flush()?;
        Ok(self.writer)
    }

    /// The rectangle that changed, in which unchanged pixels are transparent. Updates `shown`.
    fn difference(&mut self, frame: &Image) -> (Rect, Vec<u8>) {
        let width = self.size[0];
        let (mut lo, mut hi) = (self.size, [0, 0]);
        let pairs = || self.shown.chunks_exact(4).zip(frame.rgba().chunks_exact(4));
        let changed: Vec<bool> = pairs().map(|(old, new)| old[..3] != new[..3]).collect();
        for i in (0_u32..).zip(&changed).filter_map(|(i, &changed)| changed.then_some(i)) {
            let at = [i % width, i / width];
            lo = [lo[0].min(at[0]), lo[1].min(at[1])];
            hi = [hi[0].max(at[0]), hi[1].max(at[1])];
        }
        if lo == self.size {
            // Nothing changed, but a frame must have at least one pixel.
            return (Rect { x: 0, y: 0, width: 1, height: 1 }, vec![0; 4]);
        }
        let mut pixels = Vec::new();
        for pixel in (lo[1]..=hi[1]).flat_map(|y| (lo[0]..=hi[0]).map(move |x| (y * width + x) as usize)) {
            let new = &frame.rgba()[pixel * 4..pixel * 4 + 3];
            self.shown[pixel * 4..pixel * 4 + 3].copy_from_slice(new);
            pixels.extend(if changed[pixel] { [new[0], new[1], new[2], 255] } else { [0; 4] });
        }
        (Rect { x: lo[0], y: lo[1], width: hi[0] - lo[0] + 1, height: hi[1] - lo[1] + 1 }, pixels)
    }

    fn write_frame_control(&mut self, rect: Rect, blend: bool) -> Result<(), ImageError> {
        let mut control = Vec::with_capacity(26);
        for number in [self.sequence, rect.width, rect.height, rect.x, rect.y] {
            control.extend(number.to_be_bytes());
        }
        control.extend(1_u16.to_be_bytes());
        control.extend(self.fps.to_be_bytes());
        // Disposal 0: the next frame is drawn on this one. Blending 0 replaces the pixels, 1 blends
        // over them.
        control.extend([0, u8::from(blend)]);
        self.sequence += 1;
        write_chunk(&mut self.writer, *b"fcTL", &control)?;
        Ok(())
    }
}

/// The compressed image data of `pixels`, RGBA, one entry per chunk.
fn packed(pixels: &[u8], rect: Rect) -> Result<Vec<Vec<u8>>, ImageError> {
    let mut whole = Vec::new();
    let mut encoder = png::Encoder::new(&mut whole, rect.width, rect.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_compression(png::Compression::Balanced);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    // A chunk is length, name, data and checksum. Those of the encoder are complete.
    let mut chunks = Vec::new();
    let mut rest = &whole[SIGNATURE.len()..];
    while let Some((head, tail)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        if &head[4..] == b"IDAT" {
            chunks.push(tail[..length].to_vec());
        }
        rest = &tail[length + 4..];
    }
    Ok(chunks)
}

fn write_chunk(writer: &mut impl Write, name: [u8; 4], data: &[u8]) -> std::io::Result<()> {
    let length = u32::try_from(data.len()).map_err(|_| std::io::ErrorKind::InvalidInput)?;
    let mut sum = crc32fast::Hasher::new();
    sum.update(&name);
    sum.update(data);
    writer.write_all(&length.to_be_bytes())?;
    writer.write_all(&name)?;
    writer.write_all(data)?;
    writer.write_all(&sum.finalize().to_be_bytes())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// Frames with a bright square that moves. The third frame equals the second.
    fn frames() -> Vec<Image> {
        [3, 7, 7, 20]
            .map(|x| {
                let mut image = Image::filled(40, 30, [30, 40, 50, 255]).unwrap();
                image.paste(&Image::filled(5, 4, [200, 100, 0, 255]).unwrap(), x, 11);
                image
            })
            .to_vec()
    }

    /// The pictures that a viewer shows.
    fn play(bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
        let count = reader.info().animation_control().unwrap().num_frames;
        let (width, height) = reader.info().size();
        let mut canvas = vec![0_u8; (width * height * 4) as usize];
        let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
        (0..count)
            .map(|_| {
                reader.next_frame(&mut buffer).unwrap();
                let control = *reader.info().frame_control().unwrap();
                assert_eq!((control.delay_num, control.delay_den), (1, 24));
                for y in 0..control.height {
                    for x in 0..control.width {
                        let from = ((y * control.width + x) * 4) as usize;
                        let to = (((y + control.y_offset) * width + x + control.x_offset) * 4) as usize;
                        let over = control.blend_op == png::BlendOp::Over;
                        if !over || buffer[from + 3] == 255 {
                            canvas[to..to + 4].copy_from_slice(&buffer[from..from + 4]);
                        }
                    }
                }
                canvas.clone()
            })
            .collect()
    }

    fn film(frames: &[Image]) -> Vec<u8> {
        let mut film = Film::new(Cursor::new(Vec::new()), 40, 30, 24).unwrap();
        frames.iter().for_each(|f| film.push(f).unwrap());
        film.finish().unwrap().into_inner()
    }

    #[test]
    fn a_film_plays_back_frame_by_frame() {
        let frames = frames();
        let played = play(&film(&frames));
        assert_eq!(played.len(), frames.len());
        for (shown, frame) in played.iter().zip(&frames) {
            assert!(shown == frame.rgba());
        }
    }

    #[test]
    fn a_still_frame_costs_next_to_nothing() {
        let frames = frames();
        let more = film(&frames[..3]).len() - film(&frames[..2]).len();
        assert!(more < 120, "{more} bytes");
    }

    #[test]
    fn bad_films_are_refused() {
        let new = |w, h, fps| Film::new(Cursor::new(Vec::new()), w, h, fps);
        assert!(matches!(new(0, 10, 24), Err(ImageError::Size { .. })));
        assert!(matches!(new(10, 10, 0), Err(ImageError::FrameRate(0))));
        assert!(matches!(new(10, 10, 24).unwrap().finish(), Err(ImageError::FrameCount(0))));
        let wrong = Image::filled(9, 10, [0; 4]).unwrap();
        assert!(matches!(new(10, 10, 24).unwrap().push(&wrong), Err(ImageError::FrameSize { .. })));
    }
}
