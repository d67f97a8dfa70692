//! Rows read from the disk are those of the whole file.

use std::io::Write;

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::analysis::diagnostics::Diagnostics;
use crate::analysis::paths::{PathKind, SessionPaths};
use crate::analysis::protocol::SeenRow;
use crate::vision::covariance::PositionCovariance;
use crate::vision::reason::MissReason;
use crate::vision::trajectory::{Sample, SampleState};

fn file_of(bytes: &[u8]) -> Arc<File> {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(bytes).unwrap();
    Arc::new(file)
}

/// These paths as a stored file.
pub(in crate::analysis) fn stored(paths: &SessionPaths) -> StoredPaths {
    let file = file_of(&paths.to_bytes().unwrap());
    let index = PathIndex::build(file.clone()).unwrap();
    StoredPaths::new(file, Arc::new(index))
}

fn row(frame: u64, tool: usize) -> Sample {
    Sample {
        frame,
        time_s: frame as f64 * 0.04,
        tool,
        tip_mm: Point3::new(frame as f64, tool as f64, 150.0),
        velocity_mm_s: frame.is_multiple_of(3).then(|| Vector3::new(25.0, 0.0, 0.0)),
        axis: None,
        tip_px: None,
        covariance_mm2: frame.is_multiple_of(2).then(|| PositionCovariance::from_sigmas(0.1, 0.5)),
        state: SampleState::Observed,
    }
}

/// A path of two tools; the second one is absent from frame 100 to 1499. Its blocks end within frames.
fn paths(frames: u64) -> SessionPaths {
    let rows: Vec<Sample> = (0..frames)
        .flat_map(|frame| [row(frame, 0), row(frame, 1)])
        .filter(|row| row.tool == 0 || !(100..1500).contains(&row.frame))
        .collect();
    SessionPaths {
        tools: vec!["orange".to_owned(), "cyan".to_owned()],
        frame_times_s: (0..frames).map(|frame| frame as f64 * 0.04).collect(),
        raw: rows.iter().filter(|row| row.frame % 5 == 0).copied().collect(),
        filtered: Vec::new(),
        smoothed: rows,
        tracking: None,
        cuts: Vec::new(),
    }
}

fn read(stored: &StoredPaths, kind: PathKind, from_frame: u64) -> Vec<Sample> {
    let mut rows = stored.rows(kind, from_frame);
    std::iter::from_fn(|| rows.next_row().unwrap()).collect()
}

#[test]
fn rows_from_any_frame_on_are_those_of_the_whole_path() {
    let paths = paths(3000);
    let stored = stored(&paths);
    for from in [0, 1, 99, 100, 561, 562, 1023, 1024, 1500, 2011, 2012, 2013, 2999, 3000, u64::MAX] {
        let wanted = |rows: &[Sample]| rows.iter().filter(|row| row.frame >= from).copied().collect::<Vec<_>>();
        assert_eq!(read(&stored, PathKind::Smoothed, from), wanted(&paths.smoothed), "from frame {from}");
        assert_eq!(read(&stored, PathKind::Raw, from), wanted(&paths.raw), "from frame {from}");
    }
    assert!(read(&stored, PathKind::Filtered, 0).is_empty());
    assert_eq!(stored.tools(), paths.tools);
}

#[test]
fn times_of_frames_are_read_in_any_order() {
    let paths = paths(20_000); // more than a window
    let mut times = stored(&paths).frame_times();
    for frame in [0, 1, 19_999, 5, 10_000, 10_001, 20_000] {
        assert_eq!(times.at(frame).unwrap(), paths.frame_times_s.get(frame as usize).copied(), "frame {frame}");
    }
}

#[test]
fn a_damaged_file_of_paths_has_no_index() {
    let good = paths(50).to_bytes().unwrap();
    let fails = |bytes: &[u8]| PathIndex::build(file_of(bytes)).is_err();
    assert!(!fails(&good));
    for cut in [0, 7, 8, 30, good.len() / 2, good.len() - 2] {
        assert!(fails(&good[..cut]), "cut at byte {cut}");
    }
    let mut unordered = paths(50);
    unordered.smoothed.swap(3, 4);
    assert!(matches!(PathIndex::build(file_of(&unordered.to_bytes().unwrap())), Err(PathsError::OutOfOrder)));
}

fn seen(frame: u64, tool: u32) -> SeenRow {
    SeenRow {
        frame,
        tool,
        reason: (tool == 1).then_some(MissReason::TooSmall),
        borders_px: (tool == 0).then_some([[0.1, 0.2, 0.3, 0.4]; 2]),
        tip_px: Some([frame as f32 / 3.0, 7.0]),
    }
}

/// Two tools on all of these frames.
fn diagnostics(frames: std::ops::Range<u64>) -> Vec<u8> {
    let tools = ["orange".to_owned(), "\"columns\":{[cyan".to_owned()];
    let rows: Vec<SeenRow> = frames.flat_map(|frame| [seen(frame, 0), seen(frame, 1)]).collect();
    Diagnostics::new((640, 480), &tools, &rows).to_json().unwrap()
}

fn stored_diagnostics(bytes: &[u8]) -> StoredDiagnostics {
    let file = file_of(bytes);
    let index = DiagnosticsIndex::build(file.clone()).unwrap();
    StoredDiagnostics::new(file, Arc::new(index))
}

fn text(pieces: DiagnosticsPieces) -> String {
    String::from_utf8(pieces.map(Result::unwrap).collect::<Vec<_>>().concat()).unwrap()
}

#[test]
fn a_part_of_diagnostics_has_its_frames_alone_and_whole_it_is_the_same_file() {
    let whole = diagnostics(0..2000);
    let stored = stored_diagnostics(&whole);
    let select = |frames| text(stored.select_frames(frames, Box::new(|_, tool| Ok(tool))));
    assert_eq!(select(0..u64::MAX).into_bytes(), whole);
    for frames in [0..1, 5..9, 511..513, 512..1024, 1023..1025, 1999..5000, 3000..4000, 7..7] {
        let within = frames.start.min(2000)..frames.end.min(2000);
        assert_eq!(select(frames.clone()).into_bytes(), diagnostics(within), "{frames:?}");
    }
    let none = stored_diagnostics(&diagnostics(0..0)).select_frames(0..9, Box::new(|_, tool| Ok(tool)));
    assert_eq!(text(none).into_bytes(), diagnostics(0..0));
}

#[test]
fn swapped_tools_are_in_the_order_of_their_new_names() {
    let stored = stored_diagnostics(&diagnostics(0..20));
    let swapped = text(stored.select_frames(5..6, Box::new(|_, tool| Ok(1 - tool))));
    let tools = ["orange".to_owned(), "\"columns\":{[cyan".to_owned()];
    let rows = [SeenRow { tool: 0, ..seen(5, 1) }, SeenRow { tool: 1, ..seen(5, 0) }];
    assert_eq!(swapped.into_bytes(), Diagnostics::new((640, 480), &tools, &rows).to_json().unwrap());
}

#[test]
fn a_file_of_another_kind_has_no_index() {
    let whole = diagnostics(0..20);
    for bytes in
        [&b"[]"[..], b"", br#"{"columns":{}}"#, br#"{"columns":{"tool":[1],"frame":[1]}}"#, &whole[..whole.len() / 2]]
    {
        assert!(DiagnosticsIndex::build(file_of(bytes)).is_err(), "{}", String::from_utf8_lossy(bytes));
    }
}

#[tokio::test]
async fn an_index_is_kept_and_a_damaged_blob_is_refused_before_a_row_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let vault = Vault::open(folder.path()).await.unwrap();
    let blob = vault.put(&paths(50).to_bytes().unwrap()).await.unwrap();
    let hash = blob.blob().hash;
    let indexes = StoredIndexes::default();
    let first = indexes.open_paths(&vault, hash).await.unwrap();
    assert_eq!(read(&first, PathKind::Smoothed, 40).len(), 20);
    assert!(Arc::ptr_eq(&indexes.paths.find(hash).unwrap(), &indexes.paths.find(hash).unwrap()));
    let other = vault.put(b"no paths").await.unwrap();
    let refused = indexes.open_paths(&vault, other.blob().hash).await;
    assert!(matches!(refused, Err(StoredRowsError::Paths(PathsError::NotPaths))), "{refused:?}");
    for number in 0..2 * MAX_INDEXES as u64 {
        let index = indexes.paths.find(hash).unwrap_or_else(|| panic!("kept until {number}"));
        indexes.paths.keep(crate::domain::blob::Blob::of(&number.to_le_bytes()).hash, index);
    }
    assert_eq!(indexes.paths.0.lock().unwrap().len(), MAX_INDEXES);

    let path = folder.path().join("blobs").join(&hash.to_string()[..2]).join(hash.to_string());
    let mut bytes = std::fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, bytes).unwrap();
    let refused = StoredIndexes::default().open_paths(&vault, hash).await;
    assert!(matches!(refused, Err(StoredRowsError::Vault(VaultError::Damaged))), "{refused:?}");
}

proptest! {
    #[test]
    fn no_bytes_make_the_readers_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = PathIndex::build(file_of(&[&b"trocarP\x04"[..], &bytes].concat()));
        let _ = DiagnosticsIndex::build(file_of(&[&b"{\"columns\":{\"frame\":["[..], &bytes].concat()));
    }
}
