//! Which frames of a recording players show.
//!
//! Files that were trimmed without coding them again hold more frames than they show: decoding has to begin at a key
//! frame. Such frames are marked in the table that FFmpeg makes of an edit list, or have a stamp before the
//! presentation's start.

use ffmpeg_next::{ffi, format};

/// The first stamp that is shown. MP4, MOV and Matroska count from the presentation's start: frames with a negative stamp
/// lie before the start of an edit list or of a trim, and exist to decode later frames. Other containers count from
/// anywhere.
pub(in crate::media) fn first_shown(input: &format::context::Input) -> Option<i64> {
    ["mov", "matroska"].iter().any(|name| is_container(input, name)).then_some(0)
}

/// True if a frame of this stamp is not shown.
pub(in crate::media) fn is_before(pts: Option<i64>, first_shown: Option<i64>) -> bool {
    pts.zip(first_shown).is_some_and(|(pts, first_shown)| pts < first_shown)
}

/// The stamp at which the stream's presentation starts, if the container states it.
pub(in crate::media) fn start_of(stream: &format::stream::Stream<'_>, first_shown: Option<i64>) -> Option<i64> {
    let stated = Some(stream.start_time()).filter(|&start| start != ffi::AV_NOPTS_VALUE)?;
    Some(first_shown.map_or(stated, |first_shown| stated.max(first_shown)))
}

/// True if FFmpeg reads the input as this container.
pub(super) fn is_container(input: &format::context::Input, name: &str) -> bool {
    input.format().name().split(',').any(|one| one == name)
}

/// Entries of the table of frames that are to be shown; `None` without a table.
pub(super) fn table_length(stream: &format::stream::Stream<'_>) -> Option<u64> {
    let shown = (0..entries(stream)).filter(|&at| !is_hidden_entry(stream, at)).count();
    Some(shown as u64).filter(|&shown| shown > 0)
}

/// True if the table holds frames that an edit list hides.
pub(in crate::media) fn hides_frames(stream: &format::stream::Stream<'_>) -> bool {
    (0..entries(stream)).any(|at| is_hidden_entry(stream, at))
}

fn entries(stream: &format::stream::Stream<'_>) -> i32 {
    // SAFETY: the stream lives as long as its input, which is not read meanwhile.
    unsafe { ffi::avformat_index_get_entries_count(stream.as_ptr()) }
}

fn is_hidden_entry(stream: &format::stream::Stream<'_>, at: i32) -> bool {
    // SAFETY: as above; FFmpeg does not write to the stream, and returns null for a number outside its table.
    unsafe {
        let entry = ffi::avformat_index_get_entry(stream.as_ptr().cast_mut(), at);
        !entry.is_null() && (*entry).flags() & ffi::AVINDEX_DISCARD_FRAME != 0
    }
}
