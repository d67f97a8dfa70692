//! The centre's name and logo. They are no personal data: strangers see them on the sign-in page.

use super::audit::note;
use super::error::StoreResult;
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::centre::{Logo, LogoFormat};
use crate::domain::text::Name;

/// Subject of the audit trail's entries: there is one centre.
const SUBJECT: &str = "centre";

/// Access to the centre's name and logo.
pub struct CentreStore<'s>(pub(super) &'s Store);

/// The centre, without the file of its logo.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct CentreRecord {
    /// What people call it, if that was set.
    pub name: Option<Name>,
    /// SHA-256 of its logo, hexadecimal, if it has one.
    pub logo_hash: Option<String>,
}

const SELECT_CENTRE: &str = "SELECT name, logo_hash FROM centre";

const SELECT_LOGO: &str = "SELECT logo_type, logo FROM centre WHERE logo IS NOT NULL";

const UPDATE_NAME: &str = "UPDATE centre SET name = $1";

const UPDATE_LOGO: &str = "UPDATE centre SET logo = $1, logo_type = $2, logo_hash = $3";

impl CentreStore<'_> {
    /// Its name, and whether it has a logo.
    pub async fn get(&self) -> StoreResult<CentreRecord> {
        Ok(sqlx::query_as(SELECT_CENTRE).fetch_one(self.0.readers()).await?)
    }

    /// Its logo.
    pub async fn logo(&self) -> StoreResult<Option<Logo>> {
        let row: Option<(LogoFormat, Vec<u8>)> = sqlx::query_as(SELECT_LOGO).fetch_optional(self.0.readers()).await?;
        Ok(row.map(|(format, bytes)| Logo { format, bytes }))
    }

    /// Sets or removes its name.
    pub async fn set_name(&self, scope: &Scope, name: Option<Name>) -> StoreResult<()> {
        require_administrator(scope, "the name of the centre")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                sqlx::query(UPDATE_NAME).bind(name).execute(&mut *tx).await?;
                note(tx, &scope, now_ms, ("set name", "centre"), SUBJECT).await
            })
            .await
    }

    /// Sets or removes its logo.
    pub async fn set_logo(&self, scope: &Scope, logo: Option<Logo>) -> StoreResult<()> {
        require_administrator(scope, "the logo of the centre")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let hash = logo.as_ref().map(Logo::hash);
                let (format, bytes) = logo.map(|Logo { format, bytes }| (format, bytes)).unzip();
                sqlx::query(UPDATE_LOGO).bind(bytes).bind(format).bind(hash).execute(&mut *tx).await?;
                note(tx, &scope, now_ms, ("set logo", "centre"), SUBJECT).await
            })
            .await
    }
}
