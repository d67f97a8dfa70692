//! A session's path as JSON, CSV or Parquet.

use std::io::{self, Write};

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::files::FileOwner;
use crate::analysis::edits::EditedRows;
use crate::analysis::paths::PathKind;
use crate::analysis::stored_rows::StoredPaths;
use crate::domain::access::AccessedPart;
use crate::domain::edit::EditChange;
use crate::domain::files::trajectory::{BoxedRows, CsvPieces, JsonPieces, ParquetPieces, ThinnedRows, Thinning};
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::file::disposition;
use crate::http::heavy::Pieces;
use crate::http::read::{Params, PathKey};
use crate::http::state::App;

/// Format of a trajectory.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum TrajectoryFormat {
    /// CSV with one row per frame and tool.
    Csv,
    /// JSON with one array for each column.
    #[default]
    Json,
    /// Apache Parquet.
    Parquet,
}

/// One of a session's three paths.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum PathVariant {
    /// Smoothed with earlier and later frames; scores use this path.
    #[default]
    Smoothed,
    /// Filtered with earlier frames only, without the smoother; fulcrum and shared errors come from
    /// the whole recording.
    Filtered,
    /// As measured, frame by frame.
    Raw,
}

/// Allowed values of `points`.
const ALLOWED_POINTS: std::ops::RangeInclusive<usize> = 10..=100_000;

/// Selects a path and its format.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TrajectoryQuery {
    /// Format of the answer.
    #[serde(default)]
    #[param(inline)]
    format: TrajectoryFormat,
    /// Which of the three paths.
    #[serde(default)]
    #[param(inline)]
    kind: PathVariant,
    /// `true`: without the stretches that were trimmed off, as it is scored; `false`: the whole path. Swapped tool
    /// names apply in both cases.
    #[serde(default = "yes")]
    #[param(default = true)]
    trimmed: bool,
    /// Only rows of this frame and later ones.
    from_frame: Option<u64>,
    /// Only rows of frames before this one.
    to_frame: Option<u64>,
    /// Approximate maximum of rows per tool. Rows are chosen so that curves of x, y, z and speed keep their shape: the
    /// extremes of each stretch stay. In JSON, `thinned` is true if rows were left out, and `after_gap` is true for
    /// each row before which its tool was absent.
    #[param(minimum = 10, maximum = 100000)]
    points: Option<usize>,
}

fn yes() -> bool {
    true
}

/// Read the path of the tools, with the session's edits applied
#[utoipa::path(get, path = "/sessions/{id}/trajectory", tag = "sessions",
    params(("id" = String, Path, description = "id"), TrajectoryQuery),
    responses((status = OK, description = "The table: frame, time_s, tool, x_mm, …, state, cov_xx_mm2, …, cov_zz_mm2", content(
        (Object = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet")))))]
pub async fn trajectory(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    Params(wanted): Params<TrajectoryQuery>,
) -> HandlerResult<Response> {
    let id = at.id()?;
    if wanted.points.is_some_and(|points| !ALLOWED_POINTS.contains(&points)) {
        return Err(ProblemResponse::invalid(
            "points",
            format!("expected a number from {} to {}", ALLOWED_POINTS.start(), ALLOWED_POINTS.end()),
        ));
    }
    // Before anything is read: during the wait the session may be tracked again, or the caller may lose access.
    let slot = app.heavy_answers.take(&by.scope).await?;
    let (result, in_force) = app.result_with_edits(&by.scope, id).await?;
    app.note_access(&by.scope, id, AccessedPart::Path);
    if result.versions.calibration.is_none() && !matches!(wanted.kind, PathVariant::Smoothed) {
        return Err(Refusal::Conflict.with("An imported session has only one path. Request it with `kind=smoothed`."));
    }
    let mut changes = in_force.changes;
    changes.retain(|change| wanted.trimmed || !matches!(change, EditChange::Trim(_)));
    let of = FileOwner { scope: &by.scope, session: id };
    let stored = app.stored_paths(&slot, of, result.trajectory).await?;
    let name = format!("{id}.{}", wanted.format.extension());
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(wanted.format.media_type()));
    headers.extend(HeaderValue::try_from(disposition("inline", &name)).map(|name| (header::CONTENT_DISPOSITION, name)));
    let body = slot.body(move || table_pieces(&stored, &changes, wanted)).await?;
    Ok((StatusCode::OK, headers, body).into_response())
}

/// The pieces of the table. Thinning reads the rows of a long session three times, so this belongs on a blocking thread.
fn table_pieces(stored: &StoredPaths, changes: &[EditChange], wanted: TrajectoryQuery) -> HandlerResult<Pieces> {
    let unreadable = |cause| ProblemResponse::internal("reading a stored trajectory", cause);
    let frames = wanted.from_frame.unwrap_or(0)..wanted.to_frame.unwrap_or(u64::MAX);
    let mut rows = EditedRows::new(stored, wanted.kind.into(), changes, frames);
    let thinning = match wanted.points {
        Some(points) => {
            let cuts = rows.cuts().map_err(unreadable)?;
            Some(Thinning::of(&mut rows, &cuts, points).map_err(unreadable)?)
        }
        None => None,
    };
    let pieces: Pieces = match (wanted.format, thinning) {
        (TrajectoryFormat::Json, None) => Box::new(JsonPieces::new(Box::new(rows)).map_err(unreadable)?),
        (TrajectoryFormat::Json, Some(thinning)) => {
            Box::new(JsonPieces::thinned(Box::new(rows), thinning).map_err(unreadable)?)
        }
        (format, thinning) => {
            let rows: BoxedRows = match thinning {
                Some(thinning) => Box::new(ThinnedRows::new(Box::new(rows), thinning)),
                None => Box::new(rows),
            };
            if matches!(format, TrajectoryFormat::Csv) {
                Box::new(CsvPieces::new(rows))
            } else {
                let pieces = ParquetPieces::new(rows);
                Box::new(pieces.map_err(|cause| ProblemResponse::internal("writing Parquet", cause))?)
            }
        }
    };
    Ok(pieces)
}

/// Writes the smoothed path as CSV, with the edits applied, as the route does by default.
pub(in crate::http) fn write_edited_csv(
    stored: &StoredPaths,
    changes: &[EditChange],
    mut out: impl Write,
) -> io::Result<()> {
    let rows = EditedRows::new(stored, PathKind::Smoothed, changes, 0..u64::MAX);
    for piece in CsvPieces::new(Box::new(rows)) {
        out.write_all(&piece?)?;
    }
    Ok(())
}

impl TrajectoryFormat {
    fn media_type(self) -> &'static str {
        match self {
            TrajectoryFormat::Csv => "text/csv; charset=utf-8",
            TrajectoryFormat::Json => "application/json",
            TrajectoryFormat::Parquet => "application/vnd.apache.parquet",
        }
    }

    fn extension(self) -> &'static str {
        match self {
            TrajectoryFormat::Csv => "csv",
            TrajectoryFormat::Json => "json",
            TrajectoryFormat::Parquet => "parquet",
        }
    }
}

impl From<PathVariant> for PathKind {
    fn from(wanted: PathVariant) -> Self {
        match wanted {
            PathVariant::Smoothed => PathKind::Smoothed,
            PathVariant::Filtered => PathKind::Filtered,
            PathVariant::Raw => PathKind::Raw,
        }
    }
}
