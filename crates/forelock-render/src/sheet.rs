//! Contact sheets: pictures in rows, with a label under each.

use crate::font::{self, draw_text, text_width};
use crate::image::{Image, ImageError};

/// The margin around and between pictures, pixels.
const GAP: u32 = 8;
const PAPER: [u8; 4] = [24, 25, 27, 255];
const INK: [u8; 4] = [205, 207, 210, 255];

/// A picture with a label.
#[derive(Clone, Copy, Debug)]
pub struct Labelled<'a> {
    /// The picture.
    pub image: &'a Image,
    /// The label: one line, drawn in capitals and clipped to the width of the cell.
    pub label: &'a str,
}

/// A sheet of the pictures in rows of `columns`. All cells have the size of the largest picture.
///
/// # Errors
/// [`ImageError::NoPictures`], or [`ImageError::Size`] if the sheet would be over the limit.
pub fn contact_sheet(pictures: &[Labelled<'_>], columns: u32) -> Result<Image, ImageError> {
    let largest = |side: fn(&Image) -> u32| pictures.iter().map(|p| side(p.image)).max();
    let (Some(cell_width), Some(cell_height)) = (largest(Image::width), largest(Image::height)) else {
        return Err(ImageError::NoPictures);
    };
    let count = u32::try_from(pictures.len()).unwrap_or(u32::MAX);
    let columns = columns.clamp(1, count);
    let scale = (cell_width / 240).clamp(1, 3);
    let strip = (font::HEIGHT + 6) * scale;
    let (step_x, step_y) = (cell_width + GAP, cell_height + strip + GAP);
    let width = columns.saturating_mul(step_x).saturating_add(GAP);
    let height = count.div_ceil(columns).saturating_mul(step_y).saturating_add(GAP);
    let mut sheet = Image::filled(width, height, PAPER)?;
    for (i, picture) in (0..count).zip(pictures) {
        let (left, top) = (GAP + i % columns * step_x, GAP + i / columns * step_y);
        let fits = ((cell_width / scale + 1) / 6) as usize;
        let label: String = picture.label.chars().take(fits).collect();
        let indent = (cell_width - text_width(&label, scale).min(cell_width)) / 2;
        sheet.paste(picture.image, left + (cell_width - picture.image.width()) / 2, top);
        draw_text(&mut sheet, &label, left + indent, top + cell_height + 4 * scale, scale, INK);
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_rows_with_ink_below() {
        let red = Image::filled(50, 40, [255, 0, 0, 255]).unwrap();
        let blue = Image::filled(30, 30, [0, 0, 255, 255]).unwrap();
        let labelled = |image, label| Labelled { image, label };
        let pictures = [labelled(&red, "a"), labelled(&blue, "b"), labelled(&red, "")];
        let sheet = contact_sheet(&pictures, 2).unwrap();
        assert_eq!((sheet.width(), sheet.height()), (8 + 58 * 2, 8 + (40 + 13 + 8) * 2));
        assert_eq!(sheet.pixel(8, 8), [255, 0, 0, 255]);
        assert_eq!(sheet.pixel(66 + 25, 20), [0, 0, 255, 255]);
        assert_eq!(sheet.pixel(8, 8 + 61), [255, 0, 0, 255]);
        let ink = |left: u32, top: u32| {
            (0..50 * 13).filter(|i| sheet.pixel(left + i % 50, top + i / 50) == INK).count()
        };
        assert_eq!(ink(8, 48), 18, "the pixels of an A");
        assert_eq!(ink(8, 48 + 61), 0);
    }

    #[test]
    fn impossible_sheets_are_refused() {
        assert!(matches!(contact_sheet(&[], 2), Err(ImageError::NoPictures)));
        let image = Image::filled(2000, 10, [0; 4]).unwrap();
        let pictures = [Labelled { image: &image, label: "" }; 3];
        assert!(matches!(contact_sheet(&pictures, 3), Err(ImageError::Size { .. })));
        assert!(contact_sheet(&pictures, 0).is_ok());
    }
}
