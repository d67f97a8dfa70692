//! The brightness of a picture: of a whole coded one, and of the blocks of a decoded one.

use super::{FeedDecoder, MediaError, MediaLimits, Picture};
use crate::domain::feed::{FrameCodec, TimeBase};

/// Every how many rows and columns a sample is read: a whole picture of 1080p has 32,000 samples.
const STEP: usize = 8;

/// Mean luma of a key frame, 0 to 255; `None` if it cannot be decoded alone.
///
/// # Errors
/// [`MediaError`] if the decoder cannot be opened, or the picture has another size.
pub fn mean_luma(codec: FrameCodec, size: (u32, u32), frame: &[u8]) -> Result<Option<f64>, MediaError> {
    let time_base = TimeBase::try_from([1, 1000]).map_err(|error| MediaError::Container(error.to_string()))?;
    let mut decoder = FeedDecoder::new(codec, size, time_base, MediaLimits::default())?;
    decoder.send_frame(0, 0, frame)?;
    decoder.finish_input();
    let Some(picture) = decoder.next_picture()? else { return Ok(None) };
    let luma = picture.frame().y;
    let rows = (0..luma.height).step_by(STEP).map(|row| luma.row(row));
    let (sum, count) = rows
        .flat_map(|row| row.iter().step_by(STEP))
        .fold((0_u64, 0_u64), |(sum, count), sample| (sum + u64::from(*sample), count + 1));
    Ok((count > 0).then(|| sum as f64 / count as f64))
}

/// Columns and rows of [`block_means`]: a block of a picture that shows 200 mm is 6 mm wide, as wide as a shaft.
pub const BLOCK_COLUMNS: usize = 32;
/// See [`BLOCK_COLUMNS`].
pub const BLOCK_ROWS: usize = 24;
/// Every how many rows and columns a sample of a block is read.
const BLOCK_STEP: usize = 2;

/// Mean luma of each block of a picture, 0 to 255, row by row; `None` for a picture with fewer samples than blocks.
pub fn block_means(picture: &Picture) -> Option<Vec<f32>> {
    let luma = picture.frame().y;
    let (width, height) = (luma.width, luma.height);
    if width < BLOCK_COLUMNS * BLOCK_STEP || height < BLOCK_ROWS * BLOCK_STEP {
        return None;
    }
    let mut sums = vec![(0_u32, 0_u32); BLOCK_COLUMNS * BLOCK_ROWS];
    for y in (0..height).step_by(BLOCK_STEP) {
        let row = luma.row(y);
        let first = y * BLOCK_ROWS / height * BLOCK_COLUMNS;
        for x in (0..width).step_by(BLOCK_STEP) {
            let (sum, count) = &mut sums[first + x * BLOCK_COLUMNS / width];
            *sum += u32::from(row[x]);
            *count += 1;
        }
    }
    Some(sums.into_iter().map(|(sum, count)| sum as f32 / count.max(1) as f32).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::{JpegMaker, JpegStyle};

    #[test]
    fn a_grey_picture_has_its_brightness() {
        for level in [40_u8, 128, 220] {
            let picture = Picture::from_rgb(&vec![level; 3 * 64 * 48], 64, 48, 0);
            let jpeg = JpegMaker::new(JpegStyle::FULL).code(&picture.frame()).unwrap();
            let luma = mean_luma(FrameCodec::Jpeg, (64, 48), &jpeg).unwrap().unwrap();
            assert!((luma - f64::from(level)).abs() < 3.0, "{level}: {luma}");
        }
    }

    #[test]
    fn the_blocks_of_a_picture_have_their_own_brightness() {
        let (width, height) = (320, 240);
        let levels = |x: usize, y: usize| if x >= width / 2 && y < height / 2 { 200 } else { 50 };
        let pixels: Vec<u8> = (0..width * height).flat_map(|i| [levels(i % width, i / width); 3]).collect();
        let means = block_means(&Picture::from_rgb(&pixels, width, height, 0)).unwrap();
        assert_eq!(means.len(), BLOCK_COLUMNS * BLOCK_ROWS);
        for (i, mean) in means.iter().enumerate() {
            let (column, row) = (i % BLOCK_COLUMNS, i / BLOCK_COLUMNS);
            let expected = levels(column * width / BLOCK_COLUMNS, row * height / BLOCK_ROWS);
            assert!((mean - expected as f32).abs() < 3.0, "{column} {row}: {mean}");
        }
        assert!(block_means(&Picture::from_rgb(&[0; 3 * 16 * 16], 16, 16, 0)).is_none());
    }
}
