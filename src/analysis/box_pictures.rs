//! A box's own pictures of its surroundings. The job that learns the colours keeps them. For colours that an older
//! version of the program learned, the marked pictures are read again, once; the queue keeps them with that job until
//! then.

use super::job_plan::{self, JobPlan};
use super::protocol::ChildWork;
use super::worker::{WorkError, WorkerPool};
use crate::domain::job::{JobInput, PaletteInput};
use crate::domain::scope::Scope;
use crate::ids::{PaletteId, SessionId};
use crate::queue::HeldJob;
use crate::shutdown::Shutdown;
use crate::store::StoreError;
use crate::vision::surroundings::Surroundings;

impl WorkerPool {
    /// The box's own pictures that a session's recording is compared with. Empty if the marked pictures are gone,
    /// cannot be read, or are too small: then the surroundings say nothing.
    pub(super) async fn box_surroundings(
        &self,
        held: &mut HeldJob,
        (session, palette): (SessionId, PaletteId),
        ending: &Shutdown,
    ) -> Result<Vec<Surroundings>, WorkError> {
        let of = self.store.sessions().get(&Scope::service(), session).await?.box_id;
        let own = self.store.surroundings().of_box(palette, of, session).await?;
        if !own.is_empty() {
            return Ok(own);
        }
        let Some(marked) = self.marked_pictures(palette).await? else { return Ok(own) };
        match self.read_marked_pictures(held, marked, ending).await {
            Ok(picture) => {
                self.store.surroundings().add_of_palette(palette, picture).await?;
                Ok(self.store.surroundings().of_box(palette, of, session).await?)
            }
            Err(WorkError::Stopped) => Err(WorkError::Stopped),
            Err(error) => {
                tracing::warn!(%error, %palette, "marked pictures cannot be read again; surroundings not compared");
                Ok(own)
            }
        }
    }

    /// The job that learned these colours, if it is still known.
    async fn marked_pictures(&self, palette: PaletteId) -> Result<Option<PaletteInput>, StoreError> {
        let record = self.store.palettes().get(&Scope::service(), palette).await?;
        let learned = self.store.jobs().done_palette_inputs(record.box_id).await?;
        Ok(learned.into_iter().find(|input| input.annotations == record.annotations))
    }

    async fn read_marked_pictures(
        &self,
        held: &mut HeldJob,
        marked: PaletteInput,
        ending: &Shutdown,
    ) -> Result<Option<Surroundings>, WorkError> {
        let frames = (!marked.is_video).then(|| marked.frames.clone());
        let work = ChildWork::Palette(job_plan::palette_work(&marked.annotations, frames)?);
        let plan = JobPlan::new(work, &JobInput::Palette(marked), &self.vault).await?;
        Ok(self.supervise_child(held, plan, ending).await??.palette.surroundings)
    }
}
