//! A session's path as JSON, CSV or Parquet.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use crate::analysis::edits::edited_path;
use crate::analysis::paths::{Kind, Paths};
use crate::domain::edit::Change;
use crate::domain::files::trajectory::{thinned, thinned_to_json, to_json_columns, write_csv, write_parquet};
use crate::http::auth::signed_in::Member;
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::file::disposition;
use crate::http::read::{At, Params};
use crate::http::state::App;

/// Largest stored file that is read into memory, bytes: about four hours of two tools.
pub(super) const MOST: u64 = 512 * 1024 * 1024;

/// Format of a trajectory.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
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
pub enum Smoothness {
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
const POINTS: std::ops::RangeInclusive<usize> = 10..=100_000;

/// Selects a path and its format.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Wanted {
    /// Format of the answer.
    #[serde(default)]
    #[param(inline)]
    format: Format,
    /// Which of the three paths.
    #[serde(default)]
    #[param(inline)]
    kind: Smoothness,
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
    params(("id" = String, Path, description = "id"), Wanted),
    responses((status = OK, description = "The table: frame, time_s, tool, x_mm, y_mm, z_mm, …", content(
        (Object = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet")))))]
pub async fn trajectory(
    State(app): State<App>,
    by: Member,
    at: At,
    Params(wanted): Params<Wanted>,
) -> Answer<Response> {
    let id = at.id()?;
    let result = app.result(&by.scope, id).await?;
    if result.versions.calibration.is_none() && !matches!(wanted.kind, Smoothness::Smoothed) {
        return Err(Refusal::Conflict.with("An imported session has only one path. Request it with `kind=smoothed`."));
    }
    if wanted.points.is_some_and(|points| !POINTS.contains(&points)) {
        return Err(Problem::invalid(
            "points",
            format!("expected a number from {} to {}", POINTS.start(), POINTS.end()),
        ));
    }
    let edits = app.store.edits().in_force(id).await?;
    let stored = app.vault.read(result.trajectory, MOST).await?;
    // Writing a long session takes seconds, so it runs on a blocking thread.
    let written = tokio::task::spawn_blocking(move || write(&stored, edits.changes, wanted));
    let table = written.await.map_err(|cause| Problem::internal("writing a trajectory", cause))??;
    let name = format!("{id}.{}", wanted.format.extension());
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(wanted.format.media_type()));
    headers.extend(HeaderValue::try_from(disposition("inline", &name)).map(|name| (header::CONTENT_DISPOSITION, name)));
    Ok((StatusCode::OK, headers, table).into_response())
}

fn write(stored: &[u8], mut changes: Vec<Change>, wanted: Wanted) -> Answer<Vec<u8>> {
    let paths = Paths::from_bytes(stored).map_err(|cause| Problem::internal("reading a stored trajectory", cause))?;
    changes.retain(|change| wanted.trimmed || !matches!(change, Change::Trim(_)));
    let mut trajectory = edited_path(&paths, wanted.kind.into(), &changes);
    let frames = wanted.from_frame.unwrap_or(0)..wanted.to_frame.unwrap_or(u64::MAX);
    trajectory.samples.retain(|row| frames.contains(&row.frame));
    let thin = wanted.points.map(|points| thinned(&trajectory, points));
    let mut table = Vec::new();
    if let (Some(thin), Format::Json) = (&thin, wanted.format) {
        return Ok(thinned_to_json(thin).into_bytes());
    }
    let trajectory = thin.map_or(trajectory, |thin| thin.trajectory);
    match wanted.format {
        Format::Json => table = to_json_columns(&trajectory).into_bytes(),
        Format::Csv => {
            write_csv(&trajectory, &mut table).map_err(|cause| Problem::internal("writing CSV", cause))?;
        }
        Format::Parquet => {
            write_parquet(&trajectory, &mut table).map_err(|cause| Problem::internal("writing Parquet", cause))?;
        }
    }
    Ok(table)
}

impl Format {
    fn media_type(self) -> &'static str {
        match self {
            Format::Csv => "text/csv; charset=utf-8",
            Format::Json => "application/json",
            Format::Parquet => "application/vnd.apache.parquet",
        }
    }

    fn extension(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            Format::Json => "json",
            Format::Parquet => "parquet",
        }
    }
}

impl From<Smoothness> for Kind {
    fn from(wanted: Smoothness) -> Self {
        match wanted {
            Smoothness::Smoothed => Kind::Smoothed,
            Smoothness::Filtered => Kind::Filtered,
            Smoothness::Raw => Kind::Raw,
        }
    }
}
