//! One version of a box's camera. A version never changes; a new one replaces it.

use serde::{Deserialize, Serialize};

use super::files::camera::CameraFile;
use super::named;
use super::text::Invalid;

named! {
    /// The source of a calibration.
    CalibrationSource: "source" {
        /// An uploaded camera.json.
        File = "file",
        /// Photos of a checkerboard.
        Photos = "photos",
        /// A video of a checkerboard.
        Video = "video",
    }
}

/// A calibration to be stored as a box's next version.
#[derive(Clone, Debug, PartialEq)]
pub struct NewCalibration {
    /// The camera, with the calibration's own figures.
    pub camera: CameraFile,
    /// The source of the calibration.
    pub source: CalibrationSource,
    /// Recordings from then on are tracked with it, epoch ms; `None`: from the time at which it is stored.
    pub valid_from_ms: Option<i64>,
}

/// Size of a checkerboard in inner corners, written as on the command line: `9x6`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct BoardSize {
    /// Inner corners in a row.
    pub columns: u32,
    /// Rows of inner corners.
    pub rows: u32,
}

impl std::str::FromStr for BoardSize {
    type Err = Invalid;

    fn from_str(text: &str) -> Result<Self, Invalid> {
        let number = |text: &str| text.parse::<u32>().ok().filter(|n| (3..=50).contains(n));
        text.split_once('x')
            .and_then(|(columns, rows)| Some(Self { columns: number(columns)?, rows: number(rows)? }))
            .ok_or_else(|| Invalid::new("board", "expected inner corners as COLUMNSxROWS, each 3 to 50, such as 9x6"))
    }
}

impl TryFrom<String> for BoardSize {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        text.parse()
    }
}

impl From<BoardSize> for String {
    fn from(board: BoardSize) -> String {
        format!("{}x{}", board.columns, board.rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_is_columns_by_rows_and_nothing_else() {
        assert_eq!("9x6".parse(), Ok(BoardSize { columns: 9, rows: 6 }));
        for text in ["9", "9x", "9x2", "51x6", "9X6", "9x6x1", "-9x6"] {
            assert!(text.parse::<BoardSize>().is_err(), "{text}");
        }
    }
}
