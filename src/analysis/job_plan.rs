//! Looks up the rows and files that a job's child needs. Decides nothing.

use std::fs::File;

use super::protocol::{CalibrateWork, ChildWork, ColourMark, PaletteWork, RequestedBoard, SelfTestWork, TrackWork};
use super::stored_palette::read_palette;
use super::worker::WorkError;
use crate::domain::blob::BlobHash;
use crate::domain::boxes::BoxTool;
use crate::domain::files::annotations::{AnnotationsFile, LabelledRectangle, MarkerEntry, View};
use crate::domain::job::{CalibrateInput, JobInput, SelfTestInput, TrackInput};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{BoxId, CalibrationId, SessionId};
use crate::motion::quality::ports::{self, Ports};
use crate::sandbox::MAX_INPUTS;
use crate::store::{PaletteRecord, SessionOrderKey, Store, StoreError};
use crate::vault::{Vault, VaultError};
use crate::vision::camera::Camera;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::segmentation::samples::MarkedRectangle;
use crate::vision::tracker::{CameraView, HandSide, Marker, ToolSpec, TrackerSettings};

/// The work of a child and its input files.
pub(super) struct JobPlan {
    /// What the child is to do.
    pub(super) work: ChildWork,
    /// The input files.
    pub(super) inputs: Vec<File>,
}

/// The sessions of a box before a given one, with the same calibration.
#[derive(Clone, Copy, Debug)]
pub(super) struct EarlierSessions {
    in_box: BoxId,
    calibration: CalibrationId,
    before: SessionOrderKey,
    /// Sessions still being tracked before this place can change the result; later ones cannot.
    open_before: SessionOrderKey,
}

impl JobPlan {
    /// Opens the files that a job reads.
    pub(super) async fn new(work: ChildWork, job: &JobInput, vault: &Vault) -> Result<Self, WorkError> {
        let blobs = job.facts().blobs;
        if blobs.len() > MAX_INPUTS {
            return Err(too_many_files_problem(blobs.len()).into());
        }
        let mut inputs = Vec::with_capacity(blobs.len());
        for blob in blobs {
            inputs.push(vault.open_blob(blob.hash).await?.0);
        }
        Ok(Self { work, inputs })
    }

    /// The plan with the picture of the empty box as one more input.
    pub(super) async fn with_empty_box(mut self, picture: BlobHash, vault: &Vault) -> Result<Self, WorkError> {
        self.inputs.extend(open_empty_box(picture, vault).await?);
        Ok(self)
    }
}

/// Opens a picture of the empty box; `None` if it was deleted meanwhile.
///
/// # Errors
/// The vault's errors.
pub async fn open_empty_box(picture: BlobHash, vault: &Vault) -> Result<Option<File>, VaultError> {
    match vault.open_blob(picture).await {
        Ok((file, _)) => Ok(Some(file)),
        Err(VaultError::NotFound) => {
            tracing::warn!(%picture, "a deleted picture of the empty box is not used");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// The work of tracking a recording, and the picture of the empty box that it needs.
pub(super) async fn track_work(
    input: &TrackInput,
    camera: Camera,
    store: &Store,
) -> Result<(TrackWork, Option<BlobHash>), WorkError> {
    let palette = store.palettes().get(&Scope::service(), input.palette).await?;
    let empty_box = empty_box_of(&palette);
    Ok((TrackWork { tracker: tracker_settings(palette, camera, store).await?, time: input.time }, empty_box))
}

/// The picture of the empty box that was sent with these colours, if a tool without tape needs it.
fn empty_box_of(palette: &PaletteRecord) -> Option<BlobHash> {
    let is_bare = |tool: &BoxTool| tool.marker.as_ref().is_some_and(MarkerEntry::is_shaft);
    let named = palette.annotations.empty_box.as_ref().filter(|_| palette.tools.iter().any(is_bare))?;
    named.parse().ok()
}

impl EarlierSessions {
    /// The sessions before this one.
    pub(super) async fn before(id: SessionId, calibration: CalibrationId, store: &Store) -> Result<Self, StoreError> {
        let session = store.sessions().get(&Scope::service(), id).await?;
        let before = SessionOrderKey(session.created_at_ms, session.id);
        Ok(Self { in_box: session.box_id, calibration, before, open_before: before })
    }

    /// Trocar positions in these sessions; `None` while one that could contribute is being tracked, because the result
    /// must not depend on which worker was quicker. Sessions that wait in the queue, as after a crash, are not waited
    /// for: there may be no worker for them.
    pub(super) async fn ports(&mut self, store: &Store) -> Result<Option<Ports>, StoreError> {
        // Query this first: a session that ends between the two queries is then found by the second.
        let is_open = store.sessions().has_earlier_running(self.in_box, self.open_before).await?;
        let found = store.sessions().fulcrums(self.in_box, self.calibration, self.before, ports::MAX_SESSIONS).await?;
        if let Some((last, _)) = found.get(ports::MAX_SESSIONS - 1) {
            self.open_before = *last;
        }
        Ok((!is_open).then(|| ports_of_sessions(found)))
    }
}

/// Trocar positions in all of a box's sessions with this calibration.
async fn ports_so_far(of: BoxId, calibration: CalibrationId, store: &Store) -> Result<Ports, StoreError> {
    let last = SessionOrderKey(i64::MAX, SessionId::at(0)); // a time later than any session's
    Ok(ports_of_sessions(store.sessions().fulcrums(of, calibration, last, ports::MAX_SESSIONS).await?))
}

fn ports_of_sessions(found: Vec<(SessionOrderKey, Vec<Fulcrum>)>) -> Ports {
    Ports::of_sessions(&found.into_iter().map(|(_, fulcrums)| fulcrums).collect::<Vec<_>>())
}

pub(super) async fn self_test_work(input: &SelfTestInput, store: &Store) -> Result<SelfTestWork, WorkError> {
    let calibration = store.calibrations().get(&Scope::service(), input.calibration).await?;
    let palette = store.palettes().get(&Scope::service(), input.palette).await?;
    let SelfTestInput { board, square_mm, reach_mm, .. } = *input;
    Ok(SelfTestWork {
        track: tracker_settings(palette, calibration.camera.camera(), store).await?,
        board: RequestedBoard { columns: board.columns, rows: board.rows, square_mm },
        reach_mm,
        calibration_rms_px: calibration.rms_px,
        ports: ports_so_far(input.of, input.calibration, store).await?,
    })
}

async fn tracker_settings(palette: PaletteRecord, camera: Camera, store: &Store) -> Result<TrackerSettings, WorkError> {
    let view = match palette.annotations.view {
        Some(view) => Some(view),
        None => view_of(palette.box_id, store).await?,
    };
    let samples = read_palette(&palette.samples).ok_or_else(unreadable_palette_problem)?;
    let tools = palette.tools.into_iter().map(ToolSpec::from).collect();
    Ok(TrackerSettings { view: view.map(CameraView::from), ..TrackerSettings::new(camera, tools, samples) })
}

/// What a live recording in a box is tracked and judged with.
pub struct LivePlan {
    /// Camera, tools and colours.
    pub track: TrackerSettings,
    /// Trocar positions in earlier sessions.
    pub ports: Ports,
    /// The picture of the empty box, for tools without tape; see [`open_empty_box`].
    pub empty_box: Option<BlobHash>,
}

/// Looks up what a live recording in a box is tracked with, or the problem if the box lacks something.
///
/// # Errors
/// The store's errors.
pub async fn live_plan(of: BoxId, store: &Store) -> Result<Result<LivePlan, Problem>, StoreError> {
    let scope = Scope::service();
    let Some(calibration) = store.calibrations().in_use(&scope, of).await? else {
        return Ok(Err(Problem::new(
            "box-not-ready",
            "The box is not ready",
            "Measure its camera first, under “Set up” on its page.",
        )));
    };
    let Some(palette) = store.palettes().in_use(&scope, of).await? else {
        return Ok(Err(Problem::new(
            "box-not-ready",
            "The box is not ready",
            "Mark its tool colours first, under “Set up” on its page.",
        )));
    };
    let ports = ports_so_far(of, calibration.id, store).await?;
    let empty_box = empty_box_of(&palette);
    Ok(match tracker_settings(palette, calibration.camera.camera(), store).await {
        Ok(track) => Ok(LivePlan { track, ports, empty_box }),
        Err(WorkError::Impossible(problem)) => Err(problem),
        Err(WorkError::Store(error)) => return Err(error),
        Err(error) => Err(Problem::new("box-not-ready", "The box is not ready", error.to_string())),
    })
}

async fn view_of(of: BoxId, store: &Store) -> Result<Option<View>, WorkError> {
    Ok(store.boxes().get(&Scope::service(), &Key::from(&of)).await?.view)
}

/// The marks on these frames, or on a clip's frames, without a picture of the empty box.
pub(super) fn palette_work(annotations: &AnnotationsFile, frames: Option<Vec<u64>>) -> Result<PaletteWork, Problem> {
    let colour_of = |label: &LabelledRectangle| annotations.colour_of(&label.label).to_owned();
    let marks = annotations.labels.iter().map(|l| mark(l, colour_of(l))).collect::<Result<_, _>>()?;
    Ok(PaletteWork { marks, tools: annotations.tape_colours(), frames, has_empty_box: false })
}

/// Converts a rectangle into a mark with a colour.
fn mark(label: &LabelledRectangle, colour: String) -> Result<ColourMark, Problem> {
    let pixels = |n: i64| u32::try_from(n).map(|n| n as usize).map_err(|_| mark_outside_problem(label));
    let [x, y, w, h] = [pixels(label.x)?, pixels(label.y)?, pixels(label.w)?, pixels(label.h)?];
    let rectangle = MarkedRectangle { label: colour, x, y, w, h };
    Ok(ColourMark { frame: label.frame, rectangle, stroke: label.stroke })
}

pub(super) fn calibrate_work(input: &CalibrateInput, now: &str) -> CalibrateWork {
    let CalibrateInput { board, square_mm, .. } = *input;
    let names = || input.files.iter().map(|file| file.name.clone()).collect();
    CalibrateWork {
        board: RequestedBoard { columns: board.columns, rows: board.rows, square_mm },
        photos: (!input.is_video).then(names),
        calibrated_at: now.to_owned(),
    }
}

impl From<BoxTool> for ToolSpec {
    fn from(BoxTool { name, colour, side, diameter_mm, band_length_mm, marker }: BoxTool) -> Self {
        let colour = colour.unwrap_or_else(|| name.clone());
        let marker = marker.map_or(Marker::Band { length_mm: band_length_mm }, Marker::from);
        Self { name, colour, side: side.map(HandSide::from), diameter_mm, marker }
    }
}

fn mark_outside_problem(label: &LabelledRectangle) -> Problem {
    let LabelledRectangle { frame, label, x, y, w, h, .. } = label;
    let detail = format!(
        "the rectangle `{label}` on frame {frame} begins at x {x}, y {y} and measures {w}×{h}, outside the picture"
    );
    Problem::new("mark-outside", "A rectangle is outside the picture", detail)
}

fn unreadable_palette_problem() -> Problem {
    Problem::new("palette-unreadable", "The box's colours cannot be read", "mark the colours of the tools' tape again")
}

fn too_many_files_problem(given: usize) -> Problem {
    let detail = format!("{given} files were sent; at most {MAX_INPUTS} are allowed in one job");
    Problem::new("too-many-files", "Too many files for one job", detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::blob::Blob;
    use crate::ids::PaletteId;

    #[test]
    fn only_a_tool_without_tape_needs_the_picture_of_the_empty_box() {
        let picture = Blob::of(b"a box without tools").hash;
        let empty_box_for = |named: &str, marker: Option<MarkerEntry>| {
            let annotations = serde_json::json!({"empty_box": named, "labels": []});
            let tool = BoxTool {
                name: "left".into(),
                colour: Some("shaft".into()),
                side: None,
                diameter_mm: 5.0,
                band_length_mm: None,
                marker,
            };
            empty_box_of(&PaletteRecord {
                id: PaletteId::at(0),
                box_id: BoxId::at(0),
                version: 1,
                annotations: serde_json::from_value(annotations).unwrap(),
                tools: vec![tool],
                counts: vec![],
                samples: vec![],
                report: None,
                created_at_ms: 0,
                valid_from_ms: 0,
            })
        };
        let shaft = || Some(MarkerEntry::Shaft { collar_mm: None, jaw_mm: Some(28.3) });
        assert_eq!(empty_box_for(&picture.to_string(), shaft()), Some(picture));
        assert_eq!(empty_box_for(&picture.to_string(), None), None);
        assert_eq!(empty_box_for("empty.jpg", shaft()), None);
    }

    #[test]
    fn a_stored_tool_without_tape_becomes_a_shaft_of_the_tracker() {
        let tool = |marker: &str| {
            let text = format!(r#"{{"name":"left","diameter_mm":5.0,"band_length_mm":25.0{marker}}}"#);
            ToolSpec::from(serde_json::from_str::<BoxTool>(&text).unwrap()).marker
        };
        assert_eq!(tool(""), Marker::Band { length_mm: Some(25.0) });
        let shaft = Marker::Shaft { collar_mm: Some(8.0), jaw_mm: None };
        assert_eq!(tool(r#","marker":{"kind":"shaft","collar_mm":8.0}"#), shaft);
    }
}
