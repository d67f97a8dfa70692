//! The still surroundings of boxes and recordings: small pictures that say whether a recording shows its box.

use sqlx::sqlite::SqliteConnection;

use super::Store;
use super::error::StoreResult;
use crate::ids::{BoxId, PaletteId, SessionId};
use crate::vision::surroundings::Surroundings;

/// Access to the surroundings.
pub struct SurroundingsStore<'s>(pub(super) &'s Store);

/// Sessions whose surroundings a person confirmed and that new recordings are compared with, the latest first: as many
/// as a box has mats. Each comparison takes 0.1 s.
const MAX_CONFIRMED: i64 = 8;

const SELECT_OF_PALETTE: &str = "SELECT picture FROM palette_surroundings WHERE palette_id = $1";

const SELECT_OF_SESSION: &str = "SELECT picture FROM session_surroundings WHERE session_id = $1";

const SELECT_CONFIRMED: &str = "
    SELECT shown.picture FROM session JOIN session_surroundings AS shown ON shown.session_id = session.id
    WHERE session.box_id = $1 AND session.box_question = 'this_box' AND session.id <> $2
    ORDER BY session.created_at_ms DESC, session.id DESC LIMIT $3";

const INSERT_OF_PALETTE: &str = "
    INSERT INTO palette_surroundings (palette_id, picture) VALUES ($1, $2) ON CONFLICT DO NOTHING";

const INSERT_OF_SESSION: &str = "
    INSERT INTO session_surroundings (session_id, picture) VALUES ($1, $2)
    ON CONFLICT DO UPDATE SET picture = excluded.picture";

/// Other versions of the colours that still lack their surroundings keep their pictures.
const RELEASE_MARKED_PICTURES: &str = "
    DELETE FROM job_file WHERE job_id IN
        (SELECT job.id FROM job JOIN palette ON palette.box_id = job.box_id
         WHERE palette.id = $1 AND job.kind = 'palette' AND job.state = 'done'
           AND json_extract(job.input, '$.annotations') = json_extract(palette.annotations, '$'))";

impl SurroundingsStore<'_> {
    /// The box's own pictures, to compare this session with: that of its colours, then those of other sessions that a
    /// person confirmed. Empty if the colours were marked before such pictures were kept, because the confirmed
    /// sessions alone do not show all that the box can look like.
    pub async fn of_box(&self, palette: PaletteId, of: BoxId, besides: SessionId) -> StoreResult<Vec<Surroundings>> {
        let own: Option<Vec<u8>> =
            sqlx::query_scalar(SELECT_OF_PALETTE).bind(palette).fetch_optional(self.0.readers()).await?;
        let Some(own) = own else { return Ok(Vec::new()) };
        let confirmed = sqlx::query_scalar(SELECT_CONFIRMED).bind(of).bind(besides).bind(MAX_CONFIRMED);
        let confirmed: Vec<Vec<u8>> = confirmed.fetch_all(self.0.readers()).await?;
        Ok([own].iter().chain(&confirmed).filter_map(|bytes| Surroundings::from_bytes(bytes)).collect())
    }

    /// What stands still in a session's recording, if it is known.
    pub async fn of_session(&self, session: SessionId) -> StoreResult<Option<Surroundings>> {
        let row: Option<Vec<u8>> =
            sqlx::query_scalar(SELECT_OF_SESSION).bind(session).fetch_optional(self.0.readers()).await?;
        Ok(row.and_then(|bytes| Surroundings::from_bytes(&bytes)))
    }

    /// Keeps the surroundings of colours that were marked before such pictures were kept; `None` if the pictures show
    /// none. The marked pictures are then not needed any more, and are released.
    pub async fn add_of_palette(&self, palette: PaletteId, picture: Option<Surroundings>) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                if let Some(picture) = picture {
                    insert_of_palette(tx, palette, &picture).await?;
                }
                sqlx::query(RELEASE_MARKED_PICTURES).bind(palette).execute(tx).await?;
                Ok(())
            })
            .await
    }
}

pub(super) async fn insert_of_palette(
    tx: &mut SqliteConnection,
    palette: PaletteId,
    picture: &Surroundings,
) -> StoreResult<()> {
    sqlx::query(INSERT_OF_PALETTE).bind(palette).bind(picture.to_bytes()).execute(tx).await?;
    Ok(())
}

pub(super) async fn insert_of_session(
    tx: &mut SqliteConnection,
    session: SessionId,
    picture: &Surroundings,
) -> StoreResult<()> {
    sqlx::query(INSERT_OF_SESSION).bind(session).bind(picture.to_bytes()).execute(tx).await?;
    Ok(())
}
