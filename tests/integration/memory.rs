//! How memory grows with a recording's length, counted byte by byte: that of the tracker, and that of an answer with a
//! stored path.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use nalgebra::{Point3, Vector3};
use trocar::analysis::edits::EditedRows;
use trocar::analysis::paths::SessionPaths;
use trocar::analysis::stored_rows::{StoredIndexes, StoredPaths};
use trocar::domain::files::trajectory::{BoxedRows, CsvPieces, JsonPieces, ParquetPieces, Thinning};
use trocar::simulation::{Scenario, Setup, Skill};
use trocar::vault::Vault;
use trocar::vision::frame::Frame;
use trocar::vision::trajectory::{PathKind, Sample, SampleState};

use crate::truth::Recording;

/// Maximum bytes that one frame of one tool may add to the peak. During tracking its record takes 532 bytes; at the end
/// its motion takes 240 and a path 176. All paths and all steps of the smoother at once would take 2,000.
const MAX_BYTES_PER_FRAME_AND_TOOL: f64 = 600.0;

/// Maximum bytes that the answer with a path takes at once, at any length. Most of it is a row group of Parquet, or the
/// rows of JSON that are kept because they are few. A whole path of [`LONG_PATH`] takes 12 MiB as rows.
const MAX_ANSWER_BYTES: isize = 6 << 20;

/// Rows of the long path.
const LONG_PATH: u64 = 60_000;

/// An allocator that counts the bytes that each thread holds.
struct CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let held = HELD.get() + bytes;
    HELD.set(held);
    PEAK.set(PEAK.get().max(held));
}

// SAFETY: the system's allocator does all the work; counting allocates nothing.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size.cast_signed() - layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(at, layout, size) }
    }
}

/// Peak of the bytes that this thread holds while `frames` frames are tracked and a path is made from them.
fn peak_bytes(recording: &Recording, frames: usize) -> isize {
    let before = HELD.get();
    PEAK.set(before);
    let mut tracker = recording.tracker(recording.world.rig.camera);
    for index in 0..frames {
        let time_s = index as f64 / 25.0;
        tracker.observe(&Frame { index: index as u64, time_s, ..recording.frame(0) });
    }
    let tracking = tracker.finish();
    let path = tracking.trajectory(PathKind::Smoothed);
    assert_eq!(path.samples.len(), frames * path.tools.len(), "every tool is in sight all the time");
    PEAK.get() - before
}

#[test]
fn an_hour_takes_little_more_memory_than_a_minute() {
    const SHORT: usize = 512; // enough poses for every estimate that uses a limited number of them
    const LONG: usize = 2048;
    let setup = Setup { width: 640, height: 360, ..Setup::new(Scenario::Rest, Skill::INTERMEDIATE, 21) };
    let recording = Recording::with(&setup, Some(1));
    let tools = recording.world.tools.len();
    let more = peak_bytes(&recording, LONG) - peak_bytes(&recording, SHORT);
    let per_frame = more as f64 / ((LONG - SHORT) * tools) as f64;
    eprintln!("{per_frame:.0} bytes per frame and tool");
    assert!(per_frame < MAX_BYTES_PER_FRAME_AND_TOOL, "{per_frame:.0} bytes per frame and tool");
}

/// A stored path with rows of one tool.
async fn stored_path(vault: &Vault, rows: u64) -> StoredPaths {
    let row = |frame: u64| Sample {
        frame,
        time_s: frame as f64 * 0.04,
        tool: 0,
        tip_mm: Point3::new((frame as f64 / 7.0).sin(), 0.1, 150.0),
        velocity_mm_s: Some(Vector3::new(1.5, 2.5, 3.5)),
        axis: None,
        tip_px: None,
        covariance_mm2: None,
        state: SampleState::Observed,
    };
    let smoothed: Vec<Sample> = (0..rows).map(row).collect();
    let frame_times_s = smoothed.iter().map(|row| row.time_s).collect();
    let (raw, filtered, cuts) = (Vec::new(), Vec::new(), Vec::new());
    let tools = vec!["orange".to_owned()];
    let paths = SessionPaths { tools, frame_times_s, raw, filtered, smoothed, tracking: None, cuts };
    let blob = vault.put(&paths.to_bytes().unwrap()).await.unwrap();
    StoredIndexes::default().open_paths(vault, blob.blob().hash).await.unwrap()
}

/// Bytes of an answer, and the peak of those that this thread holds while it is made.
fn answer_bytes<P: Iterator<Item = std::io::Result<Vec<u8>>>>(pieces: impl FnOnce() -> P) -> (usize, isize) {
    let before = HELD.get();
    PEAK.set(before);
    let bytes = pieces().map(|piece| piece.unwrap().len()).sum();
    (bytes, PEAK.get() - before)
}

#[tokio::test]
async fn an_answer_with_a_path_takes_little_memory_at_any_length() {
    let folder = tempfile::tempdir().unwrap();
    let vault = Vault::open(folder.path()).await.unwrap();
    let stored = stored_path(&vault, LONG_PATH).await;
    let rows = || -> BoxedRows { Box::new(EditedRows::new(&stored, PathKind::Smoothed, &[], 0..u64::MAX)) };
    let thinned = || JsonPieces::thinned(rows(), Thinning::of(&mut *rows(), &[], 4000).unwrap()).unwrap();
    let answers = [
        ("JSON", 4 << 20, answer_bytes(|| JsonPieces::new(rows()).unwrap())),
        ("thinned JSON", 1 << 17, answer_bytes(thinned)),
        ("CSV", 3 << 20, answer_bytes(|| CsvPieces::new(rows()))),
        ("Parquet", 1 << 19, answer_bytes(|| ParquetPieces::new(rows()).unwrap())),
    ];
    for (format, least, (bytes, peak)) in answers {
        eprintln!("{format}: {} KiB for an answer of {} KiB", peak / 1024, bytes / 1024);
        assert!(bytes > least, "{format}: {bytes} bytes");
        assert!(peak < MAX_ANSWER_BYTES, "{format}: {peak} bytes");
    }
}
