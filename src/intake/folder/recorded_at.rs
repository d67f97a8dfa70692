//! When a recording was made: as the map says, else as its name or a folder's says, else as the file itself says.

use std::fmt;

use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use crate::time::from_rfc3339;

/// Hour that a day without a time gets: none of the day's recordings is then dated into the day before or after it, in
/// any time zone.
const NOON: i8 = 12;

/// Where a time comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeSource {
    /// The column `recorded_at` of the map.
    Map,
    /// The file's name.
    FileName,
    /// A folder's name.
    Folder,
    /// The file's own statement.
    File,
}

/// When a recording was made, and who says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordedAt {
    /// Epoch ms.
    pub at_ms: i64,
    /// Where the time comes from.
    pub source: TimeSource,
    /// True if only the day is known; the time is then noon.
    pub is_day: bool,
}

impl fmt::Display for TimeSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Map => "map",
            Self::FileName => "file name",
            Self::Folder => "folder",
            Self::File => "inside the file",
        })
    }
}

impl RecordedAt {
    /// The time that the map states: RFC 3339, or `2024-03-11`, with `14:05` or `14:05:30`, in this time zone.
    pub fn of_map(text: &str, zone: &TimeZone) -> Option<Self> {
        let source = TimeSource::Map;
        if let Some(at_ms) = from_rfc3339(text) {
            return Some(Self { at_ms, source, is_day: false });
        }
        let (found, end) = find(text)?;
        (end == text.len() && text.starts_with(|c: char| c.is_ascii_digit())).then(|| found.at(zone, source)).flatten()
    }

    /// The time in the name of a file, or in that of the innermost folder that has one. `path` has slashes.
    pub fn of_path(path: &str, zone: &TimeZone) -> Option<Self> {
        let mut names = path.rsplit('/');
        let of_file = names.next().and_then(find).and_then(|(found, _)| found.at(zone, TimeSource::FileName));
        of_file.or_else(|| names.find_map(find).and_then(|(found, _)| found.at(zone, TimeSource::Folder)))
    }

    /// The time that the file itself states.
    pub fn of_file(at_ms: i64) -> Self {
        Self { at_ms, source: TimeSource::File, is_day: false }
    }
}

/// A day with or without a time of the day, as written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct WrittenTime {
    day: (i16, i8, i8),
    time: Option<(i8, i8, i8)>,
}

impl WrittenTime {
    fn at(self, zone: &TimeZone, source: TimeSource) -> Option<RecordedAt> {
        let ((year, month, day), (hour, minute, second)) = (self.day, self.time.unwrap_or((NOON, 0, 0)));
        let written = DateTime::new(year, month, day, hour, minute, second, 0).ok()?;
        let at_ms = written.to_zoned(zone.clone()).ok()?.timestamp().as_millisecond();
        Some(RecordedAt { at_ms, source, is_day: self.time.is_none() })
    }
}

/// The first day in a text, and the time behind it, such as `2024-03-11_14-05`, `20240311_140530` or
/// `2024.03.11 14h05`. Also where it ends.
fn find(text: &str) -> Option<(WrittenTime, usize)> {
    let bytes = text.as_bytes();
    (0..bytes.len()).find_map(|start| {
        let is_inside_number = start > 0 && bytes[start - 1].is_ascii_digit();
        if is_inside_number { None } else { read_day(bytes, start) }
    })
}

fn read_day(bytes: &[u8], start: usize) -> Option<(WrittenTime, usize)> {
    let (year, at) = number(bytes, start, 4)?;
    let separator = bytes.get(at).copied().filter(|byte| b"-._".contains(byte));
    let skip = |at: usize| match separator {
        Some(byte) => (bytes.get(at) == Some(&byte)).then_some(at + 1),
        None => Some(at),
    };
    let (month, at) = number(bytes, skip(at)?, 2)?;
    let (day, at) = number(bytes, skip(at)?, 2)?;
    if !(1990..=2099).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let day = (year, i8::try_from(month).ok()?, i8::try_from(day).ok()?);
    match read_time(bytes, at) {
        Some((time, end)) => Some((WrittenTime { day, time: Some(time) }, end)),
        None if bytes.get(at).is_some_and(u8::is_ascii_digit) => None, // a longer number is no date
        None => Some((WrittenTime { day, time: None }, at)),
    }
}

/// The time of the day behind a day: directly, or after a blank, `_`, `-`, `T` or a comma.
fn read_time(bytes: &[u8], at: usize) -> Option<((i8, i8, i8), usize)> {
    let begins = bytes[at.min(bytes.len())..].iter().position(u8::is_ascii_digit)?;
    let between = &bytes[at..at + begins];
    let digits = bytes[at + begins..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let follows_directly = between.is_empty() && !matches!(digits, 4 | 6); // 20240311140530 is one run of digits
    if follows_directly || !between.iter().all(|byte| b" _-T,".contains(byte)) {
        return None;
    }
    let (hour, at) = number(bytes, at + begins, 2)?;
    let skip = |at: usize| at + usize::from(bytes.get(at).is_some_and(|byte| b"-._:h".contains(byte)));
    let (minute, at) = number(bytes, skip(at), 2)?;
    let (second, end) = number(bytes, skip(at), 2).filter(|(second, _)| *second < 60).unwrap_or((0, at));
    if hour > 23 || minute > 59 || bytes.get(end).is_some_and(u8::is_ascii_digit) && second == 0 && end == at {
        return None;
    }
    Some(((i8::try_from(hour).ok()?, i8::try_from(minute).ok()?, i8::try_from(second).ok()?), end))
}

/// A number of exactly so many digits.
fn number(bytes: &[u8], at: usize, digits: usize) -> Option<(i16, usize)> {
    let text = bytes.get(at..at + digits)?;
    let number = text.iter().all(u8::is_ascii_digit).then(|| std::str::from_utf8(text).ok()?.parse().ok());
    Some((number.flatten()?, at + digits))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::to_rfc3339;

    fn berlin() -> TimeZone {
        TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").unwrap() // does not depend on the zones of the machine
    }

    fn of_path(path: &str) -> Option<(String, TimeSource, bool)> {
        let found = RecordedAt::of_path(path, &berlin())?;
        Some((to_rfc3339(found.at_ms), found.source, found.is_day))
    }

    #[test]
    fn the_usual_ways_to_write_a_time_are_read_in_the_time_zone() {
        for name in [
            "2024-03-11_14-05.mp4",
            "VID_20240311_140500.mp4",
            "20240311140.mp4 2024-03-11T14:05:00",
            "box 2024.03.11 14h05 Ada.mkv",
            "2024-03-11 14.05.00.mov",
            "peg-2024_03_11-1405.avi",
            "20240311140500.mp4",
        ] {
            let expected = Some(("2024-03-11T13:05:00Z".to_owned(), TimeSource::FileName, false));
            assert_eq!(of_path(name), expected, "{name}");
        }
        assert_eq!(of_path("2024-07-11_14-05.mp4").unwrap().0, "2024-07-11T12:05:00Z", "summer time");
        assert_eq!(of_path("a/2024-03-11/1.mp4"), Some(("2024-03-11T11:00:00Z".into(), TimeSource::Folder, true)));
        assert_eq!(of_path("2023/2024-03-11/2024-03-12/7.mp4").unwrap().0, "2024-03-12T11:00:00Z", "the inner folder");
        assert_eq!(of_path("2024-03-11/2024-03-12_08-00.mp4").unwrap().0, "2024-03-12T07:00:00Z", "the file first");
    }

    #[test]
    fn other_numbers_are_no_dates() {
        for name in [
            "clip.mp4",
            "12345678901234.mp4",
            "2024-13-11.mp4",
            "2024-02-31.mp4",
            "1080p-60.mp4",
            "20240311.5",
            "2024.mp4",
        ] {
            let found = of_path(name);
            assert_eq!(found.is_some(), name == "20240311.5", "{name}: {found:?}");
        }
    }

    #[test]
    fn the_map_states_a_time_or_a_day_and_nothing_else() {
        let of_map =
            |text: &str| RecordedAt::of_map(text, &berlin()).map(|found| (to_rfc3339(found.at_ms), found.is_day));
        assert_eq!(of_map("2024-03-11T14:05:00Z"), Some(("2024-03-11T14:05:00Z".into(), false)));
        assert_eq!(of_map("2024-03-11 14:05"), Some(("2024-03-11T13:05:00Z".into(), false)));
        assert_eq!(of_map("2024-03-11"), Some(("2024-03-11T11:00:00Z".into(), true)));
        for wrong in ["11.03.2024", "2024-03-11 noon", "on 2024-03-11", "yesterday", ""] {
            assert_eq!(of_map(wrong), None, "{wrong}");
        }
    }
}
