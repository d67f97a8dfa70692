//! The brightness of a single coded picture.

use super::{FeedDecoder, MediaError, MediaLimits};
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::{JpegMaker, JpegStyle, Picture};

    #[test]
    fn a_grey_picture_has_its_brightness() {
        for level in [40_u8, 128, 220] {
            let picture = Picture::from_rgb(&vec![level; 3 * 64 * 48], 64, 48, 0);
            let jpeg = JpegMaker::new(JpegStyle::FULL).code(&picture.frame()).unwrap();
            let luma = mean_luma(FrameCodec::Jpeg, (64, 48), &jpeg).unwrap().unwrap();
            assert!((luma - f64::from(level)).abs() < 3.0, "{level}: {luma}");
        }
    }
}
