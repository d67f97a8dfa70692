//! The installation that the database belongs to. A restored backup belongs to the same one.

use super::Store;
use super::error::StoreResult;
use crate::ids::InstallationId;

/// Access to the installation.
pub struct InstallationStore<'s>(pub(super) &'s Store);

const SELECT_ID: &str = "SELECT id FROM installation";

const SELECT_BACKUP_FOLDER: &str = "SELECT backup_folder FROM installation";

const UPDATE_BACKUP_FOLDER: &str = "UPDATE installation SET backup_folder = $1";

impl InstallationStore<'_> {
    /// Its id, made at the first start.
    pub async fn id(&self) -> StoreResult<InstallationId> {
        Ok(sqlx::query_scalar(SELECT_ID).fetch_one(self.0.readers()).await?)
    }

    /// The folder of the scheduled backups that was noted last.
    pub async fn backup_folder(&self) -> StoreResult<Option<String>> {
        Ok(sqlx::query_scalar(SELECT_BACKUP_FOLDER).fetch_one(self.0.readers()).await?)
    }

    /// Notes the folder of the scheduled backups.
    pub async fn set_backup_folder(&self, folder: Option<String>) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                sqlx::query(UPDATE_BACKUP_FOLDER).bind(folder).execute(tx).await?;
                Ok(())
            })
            .await
    }
}
