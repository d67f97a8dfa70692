//! A trainee's sessions as xAPI statements.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use axum::extract::State;
use axum::http::HeaderMap;

use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::domain::xapi::StatementResult;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, Params, PathKey};
use crate::http::sessions::statement;
use crate::http::show::Paging;
use crate::http::state::App;
use crate::store::{SessionFilter, StandardRecord};

/// Most statements on a page, because each needs a whole result.
const MAX_STATEMENTS_PER_PAGE: u32 = 50;

/// List a trainee's sessions as xAPI statements, the last to arrive first
///
/// The format is that of a learning record store: `more` is the address of the next page, and empty on the last one.
/// Sessions without a result and sessions that were set aside have no statement.
#[utoipa::path(get, path = "/trainees/{id}/xapi", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), Paging),
    responses((status = OK, body = StatementResult)))]
pub async fn xapi(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(paging): Params<Paging>,
    headers: HeaderMap,
) -> HandlerResult<Json<StatementResult>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?;
    let home = app.base_url(&headers);
    let paging = paging.at_most(MAX_STATEMENTS_PER_PAGE);
    let limit = paging.limit();
    let page = paging.request(format!("xapi-statements/{}", trainee.id), app.settings.page_items)?;
    let filter = SessionFilter {
        trainee: Some(Key::from(&trainee.id)),
        status: Some(SessionStatus::Done),
        only_counting: true,
        ..SessionFilter::default()
    };
    let found = app.store.sessions().list(&by.scope, &filter, &page).await?;
    app.note_export(&by.scope, trainee.id);
    let (mut statements, mut standards) = (Vec::with_capacity(found.items.len()), HashMap::new());
    for session in &found.items {
        let Some(result) = app.store.sessions().result(&by.scope, session.id).await? else { continue };
        let versions: &mut Vec<_> = match standards.entry(session.task_id) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(app.store.standards().of_tasks(&by.scope, &[session.task_id]).await?),
        };
        let standard = StandardRecord::valid_at(versions, session.created_at_ms);
        statements.push(statement(&home, session, &result, standard));
    }
    let of = |cursor| {
        let limit = limit.map(|limit| format!("&limit={limit}")).unwrap_or_default();
        format!("{}/api/v1/trainees/{}/xapi?cursor={cursor}{limit}", app.settings.base_path, trainee.id)
    };
    Ok(Json(StatementResult { statements, more: found.next.map(of).unwrap_or_default() }))
}
