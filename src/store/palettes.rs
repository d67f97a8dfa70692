//! Versions of the boxes' colour samples: added, never changed, except for the date since which they are valid. A recording
//! is tracked with the version that was valid when it was recorded ([`super::box_versions`]).

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::boxes::BoxTool;
use crate::domain::files::annotations::{AnnotationsError, AnnotationsFile, ToolSize};
use crate::domain::palette::{LabelCount, NewPalette, PaletteReport};
use crate::ids::{BoxId, PaletteId};

/// Access to the boxes' colours. New versions come from a palette job ([`super::JobStore::finish_palette`]).
pub struct PaletteStore<'s>(pub(super) &'s Store);

/// A version of a box's colour samples.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct PaletteRecord {
    /// Its id.
    pub id: PaletteId,
    /// Its box.
    pub box_id: BoxId,
    /// 1, 2, … within the box.
    pub version: i64,
    /// The areas that the instructor marked.
    #[sqlx(json)]
    pub annotations: AnnotationsFile,
    /// The tools, with their sizes.
    #[sqlx(json)]
    pub tools: Vec<BoxTool>,
    /// The number of samples of each label.
    #[sqlx(json)]
    pub counts: Vec<LabelCount>,
    /// The samples, in the tracker's format.
    pub samples: Vec<u8>,
    /// The report on their quality; `None` for versions from before this report existed.
    #[sqlx(json(nullable))]
    pub report: Option<PaletteReport>,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
    /// Recordings from then on are tracked with it, epoch ms: when it was stored, unless staff stated another time.
    pub valid_from_ms: i64,
}

/// `$4`: now.
const SELECT_IN_USE: &str = "
    SELECT id, box_id, version, annotations, tools, counts, samples, report, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM palette
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id)
    ORDER BY coalesce(valid_from_ms, created_at_ms) <= $4 DESC,
             abs($4 - coalesce(valid_from_ms, created_at_ms)), version DESC LIMIT 1";

const SELECT_PALETTE: &str = "
    SELECT id, box_id, version, annotations, tools, counts, samples, report, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM palette
    WHERE id = $3 AND ($1 <> 'agent' OR $2 = box_id)";

const SELECT_PALETTES: &str = "
    SELECT id, box_id, version, annotations, tools, counts, samples, report, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM palette
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id) ORDER BY created_at_ms DESC, version DESC LIMIT 100";

/// A photo that was deleted with a person's recording has no file any more.
const SELECT_EMPTY_BOX: &str = "
    SELECT hash, bytes FROM blob
    WHERE dropped_at_ms IS NULL AND EXISTS (SELECT 1 FROM job_file WHERE job_file.blob = blob.hash)
      AND hash = (
        SELECT json_extract(annotations, '$.empty_box') FROM palette
        WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id)
          AND EXISTS (SELECT 1 FROM json_each(tools) WHERE json_extract(value, '$.marker.kind') = 'shaft')
        ORDER BY created_at_ms DESC, version DESC LIMIT 1)";

const UPDATE_VIEW: &str = "UPDATE training_box SET view = coalesce($2, view) WHERE id = $1";

const INSERT_PALETTE: &str = "
    INSERT INTO palette (id, box_id, version, annotations, tools, counts, samples, report, created_at_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5, $6, $7, $8 FROM palette
    WHERE box_id = $2
    RETURNING id, box_id, version, annotations, tools, counts, samples, report, created_at_ms,
              coalesce(valid_from_ms, created_at_ms) AS valid_from_ms";

const COPY_SURROUNDINGS: &str = "
    INSERT INTO palette_surroundings (palette_id, picture)
    SELECT $2, picture FROM palette_surroundings WHERE palette_id = $1";

impl PaletteStore<'_> {
    /// Adds a version with the samples of the one in use and other sizes of its tools. If
    /// the sizes are those in use, that one is returned.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if the box has no colours, or if the sizes cannot be used.
    pub async fn resize(&self, scope: &Scope, of: BoxId, sizes: Vec<ToolSize>) -> StoreResult<PaletteRecord> {
        let now = self.in_use(scope, of).await?;
        let now =
            now.ok_or_else(|| StoreError::refused("the tools of this box are not marked yet: mark them first"))?;
        let unusable = |error: AnnotationsError| StoreError::refused(error.to_string());
        let annotations = now.annotations.clone().with_sizes(sizes).map_err(unusable)?;
        let tools: Vec<BoxTool> =
            annotations.marked_tools().map_err(unusable)?.into_iter().map(BoxTool::from).collect();
        if tools == now.tools {
            return Ok(now);
        }
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let in_use = sqlx::query_as::<_, PaletteRecord>(SELECT_IN_USE).bind_scope(&by).bind(of).bind(now_ms);
                if in_use.fetch_optional(&mut *tx).await?.is_none_or(|in_use| in_use.id != now.id) {
                    return Err(StoreError::refused("the tools were marked again meanwhile: look at them first"));
                }
                let PaletteRecord { id: before, counts, samples, report, .. } = now;
                let new = NewPalette {
                    annotations,
                    tools,
                    counts,
                    samples,
                    report: report.unwrap_or_default(),
                    surroundings: None,
                };
                let made = insert(tx, of, new, now_ms).await?;
                sqlx::query(COPY_SURROUNDINGS).bind(before).bind(made.id).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("change tool sizes", "box"), of).await?;
                Ok(made)
            })
            .await
    }

    /// The version in use, if the box has one.
    pub async fn in_use(&self, scope: &Scope, of: BoxId) -> StoreResult<Option<PaletteRecord>> {
        let row = sqlx::query_as(SELECT_IN_USE).bind_scope(scope).bind(of).bind(self.0.now_ms());
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// The photo of the empty box that was kept with the latest colours of tools without tape, while its file is stored.
    pub async fn empty_box(&self, scope: &Scope, of: BoxId) -> StoreResult<Option<Blob>> {
        let row = sqlx::query_as::<_, (BlobHash, i64)>(SELECT_EMPTY_BOX).bind_scope(scope).bind(of);
        let found = row.fetch_optional(self.0.readers()).await?;
        Ok(found.map(|(hash, bytes)| Blob { hash, bytes: bytes.unsigned_abs() }))
    }

    /// One version.
    pub async fn get(&self, scope: &Scope, id: PaletteId) -> StoreResult<PaletteRecord> {
        let row = sqlx::query_as(SELECT_PALETTE);
        let row = row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("palette"))
    }

    /// The last hundred versions, newest first.
    pub async fn list(&self, scope: &Scope, of: BoxId) -> StoreResult<Vec<PaletteRecord>> {
        let rows = sqlx::query_as(SELECT_PALETTES);
        Ok(rows.bind_scope(scope).bind(of).fetch_all(self.0.readers()).await?)
    }
}

/// Inserts the box's next version. If the annotations name a view, it becomes the box's view.
pub(super) async fn insert(
    tx: &mut SqliteConnection,
    of: BoxId,
    new: NewPalette,
    now_ms: i64,
) -> StoreResult<PaletteRecord> {
    sqlx::query(UPDATE_VIEW).bind(of).bind(new.annotations.view).execute(&mut *tx).await?;
    let row = sqlx::query_as(INSERT_PALETTE);
    let row = row.bind(PaletteId::at(now_ms)).bind(of).bind(Json(new.annotations)).bind(Json(new.tools));
    let row = row.bind(Json(new.counts)).bind(new.samples).bind(Json(new.report)).bind(now_ms);
    row.fetch_one(tx).await.map_err(missing("box"))
}
