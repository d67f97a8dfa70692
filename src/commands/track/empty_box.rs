//! Reads the picture of the empty box.

use std::fs::File;
use std::path::Path;

use super::{CommandFailure, TrackArgs, about};
use crate::analysis::empty_box::read_empty_box;
use crate::domain::files::annotations::AnnotationsFile;
use crate::media::{MediaLimits, Picture, RecordingInfo};

/// The picture that the option names, else the one that the annotations name; its size is that of the recording.
pub(super) fn empty_box(
    args: &TrackArgs,
    marked: &AnnotationsFile,
    recording: &RecordingInfo,
) -> Result<Option<Picture>, CommandFailure> {
    let folder = args.annotations.parent().unwrap_or(Path::new("."));
    let named = marked.empty_box.as_ref().map(|name| folder.join(name));
    let Some(path) = args.empty.clone().or(named) else { return Ok(None) };
    let file = File::open(&path).map_err(|e| about(&path, e))?;
    let size = [recording.width, recording.height].map(|size| size as usize);
    read_empty_box(file, size, MediaLimits::default()).map(Some).map_err(|e| about(&path, e))
}
