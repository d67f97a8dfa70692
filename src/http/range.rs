//! Byte ranges of a file (RFC 9110, section 14): a single range, and `If-Range`.

use axum::http::{HeaderMap, header};

/// The bytes of a file that a request asks for.
#[derive(Debug, PartialEq, Eq)]
pub enum RequestedRange {
    /// The whole file: there is no range, the range may be ignored, or the file changed since the client's part.
    Whole,
    /// `first..=last`, both inside the file.
    Part {
        /// First byte, from 0.
        first: u64,
        /// Last byte, included.
        last: u64,
    },
    /// A range outside the file.
    Outside,
}

/// Reads `Range` and `If-Range` for a file of this length and ETag.
///
/// A request for several ranges is answered with the whole file, as the RFC allows: no player sends one, and they are a
/// known way to overload a server.
pub fn requested_range(headers: &HeaderMap, length: u64, etag: &str) -> RequestedRange {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    if text(header::IF_RANGE).is_some_and(|condition| condition != etag) {
        return RequestedRange::Whole;
    }
    let Some(range) = text(header::RANGE).and_then(|range| range.trim().strip_prefix("bytes=")) else {
        return RequestedRange::Whole;
    };
    match range.trim().split_once('-') {
        Some(("", suffix)) => number(suffix).map_or(RequestedRange::Whole, |count| last_bytes(count, length)),
        Some((first, last)) => match (number(first), number(last)) {
            (Some(first), None) if last.is_empty() => part(first, u64::MAX, length),
            (Some(first), Some(last)) if first <= last => part(first, last, length),
            _ => RequestedRange::Whole,
        },
        None => RequestedRange::Whole,
    }
}

/// Parses digits only: HTTP does not allow `+1` and ` 1`, unlike Rust's number parser.
fn number(text: &str) -> Option<u64> {
    if text.is_empty() || !text.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    Some(text.parse().unwrap_or(u64::MAX)) // a number that does not fit lies far outside any file
}

fn part(first: u64, last: u64, length: u64) -> RequestedRange {
    if first >= length { RequestedRange::Outside } else { RequestedRange::Part { first, last: last.min(length - 1) } }
}

fn last_bytes(count: u64, length: u64) -> RequestedRange {
    if count == 0 || length == 0 {
        return RequestedRange::Outside;
    }
    RequestedRange::Part { first: length.saturating_sub(count), last: length - 1 }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;
    use proptest::prelude::*;

    use super::*;

    fn ask(range: &str, length: u64) -> RequestedRange {
        let headers = HeaderMap::from_iter([(header::RANGE, HeaderValue::from_str(range).unwrap())]);
        requested_range(&headers, length, "\"x\"")
    }

    #[test]
    fn the_forms_of_the_standard_are_understood() {
        assert_eq!(ask("bytes=0-499", 1000), RequestedRange::Part { first: 0, last: 499 });
        assert_eq!(ask("bytes=500-", 1000), RequestedRange::Part { first: 500, last: 999 });
        assert_eq!(ask("bytes=-1", 1000), RequestedRange::Part { first: 999, last: 999 });
        assert_eq!(ask("bytes=-5000", 1000), RequestedRange::Part { first: 0, last: 999 });
        assert_eq!(ask("bytes=999-99999999999999999999999", 1000), RequestedRange::Part { first: 999, last: 999 });
        assert_eq!(ask("bytes=1000-", 1000), RequestedRange::Outside);
        assert_eq!(ask("bytes=-0", 1000), RequestedRange::Outside);
        assert_eq!(ask("bytes=0-", 0), RequestedRange::Outside);
    }

    #[test]
    fn anything_but_a_single_range_gives_the_whole_file() {
        for range in ["bytes=0-1,3-4", "bytes=5-4", "bytes=", "bytes=-", "lines=0-1", "bytes=+1-2", "bytes=a-b", "0-1"]
        {
            assert_eq!(ask(range, 1000), RequestedRange::Whole, "{range}");
        }
    }

    #[test]
    fn a_part_of_another_version_is_not_continued() {
        let headers = HeaderMap::from_iter([
            (header::RANGE, HeaderValue::from_static("bytes=5-")),
            (header::IF_RANGE, HeaderValue::from_static("\"old\"")),
        ]);
        assert_eq!(requested_range(&headers, 10, "\"new\""), RequestedRange::Whole);
        assert_eq!(requested_range(&headers, 10, "\"old\""), RequestedRange::Part { first: 5, last: 9 });
    }

    proptest! {
        #[test]
        fn a_part_always_lies_inside_the_file(range in "bytes=[0-9]{0,22}-[0-9]{0,22}", length in any::<u64>()) {
            if let RequestedRange::Part { first, last } = ask(&range, length) {
                prop_assert!(first <= last && last < length);
            }
        }
    }
}
