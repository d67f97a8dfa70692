//! Routes that others replaced. Each has the handler of its replacement, so that clients of earlier releases work.
//! Its description is marked as deprecated, and its answers name the new address.

use axum::extract::{Request, State};
use axum::handler::Handler;
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::on;
use utoipa::openapi::path::Paths;
use utoipa::openapi::{Deprecated, HttpMethod};
use utoipa_axum::PathItemExt;
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouter};
use utoipa_axum::routes;

use super::state::App;
use super::{boxes, courses, rescorings, service, sessions};

/// The `Deprecation` header (RFC 9745).
const DEPRECATION: HeaderName = HeaderName::from_static("deprecation");
/// Its value: the day since when these routes are deprecated, 27 November 2026.
const DEPRECATED_SINCE: HeaderValue = HeaderValue::from_static("@1795737600");

/// Every replaced route, with the handler of the route that replaced it.
pub fn replaced_routes() -> OpenApiRouter<App> {
    use HttpMethod::{Delete, Get, Post, Put};
    [
        replaced(Get, "/audit", service::audit, routes!(service::audit)),
        replaced(Get, "/boxes/{id}/palette", boxes::palettes, routes!(boxes::palettes)),
        replaced(Put, "/boxes/{id}/palette", boxes::learn_palette, routes!(boxes::learn_palette)),
        replaced(Post, "/boxes/{id}/palette/preview", boxes::preview_palette, routes!(boxes::preview_palette)),
        replaced(Post, "/boxes/{id}/palette/advice", boxes::advise, routes!(boxes::advise)),
        replaced(Delete, "/rescorings/{id}", rescorings::cancel, routes!(rescorings::cancel)),
        replaced(Delete, "/sessions/{id}/edits/{edit}", sessions::undo_edit, routes!(sessions::undo_edit)),
        replaced(Get, "/trainees/{id}/course", courses::of_trainee, routes!(courses::of_trainee)),
    ]
    .into_iter()
    .fold(OpenApiRouter::new(), OpenApiRouter::routes)
}

/// The route `method path`, which the one that `described` describes replaced. Both have the same handler.
fn replaced<T: 'static>(
    method: HttpMethod,
    path: &'static str,
    handler: impl Handler<T, App>,
    described: UtoipaMethodRouter<App>,
) -> UtoipaMethodRouter<App> {
    let (schemas, mut new, _) = described;
    let (new_path, item) = new.paths.pop_first().unwrap_or_default();
    let new_method = if item.get.is_some() { "GET" } else { "POST" }; // a replacement reads or acts
    let mut operation = item.get.or(item.post).unwrap_or_default();
    operation.deprecated = Some(Deprecated::True);
    operation.description = Some(format!("Use `{new_method} /api/v1{new_path}` instead: the answer is the same."));
    operation.operation_id = None;
    let link = from_fn_with_state(ReplacedRoute { path, new_path }, name_new_address);
    let route = on(method.to_method_filter(), handler).route_layer(link);
    let mut paths = Paths::new();
    paths.add_path_operation(path, vec![method], operation);
    (schemas, paths, route)
}

/// A replaced path and the new one. Both name their variable parts alike.
#[derive(Clone)]
struct ReplacedRoute {
    path: &'static str,
    new_path: String,
}

impl ReplacedRoute {
    /// The new address of the resource at this old one.
    fn new_address(&self, requested: &str) -> String {
        let parts = self.path.split('/').zip(requested.split('/'));
        let variable = parts.filter(|(name, _)| name.starts_with('{'));
        let path = variable.fold(self.new_path.clone(), |path, (name, value)| path.replace(name, value));
        format!("/api/v1{path}")
    }
}

/// Middleware: adds the new address to an answer, as `Deprecation` and `Link` (RFC 8288).
async fn name_new_address(State(route): State<ReplacedRoute>, request: Request, next: Next) -> Response {
    let link = format!("<{}>; rel=\"successor-version\"", route.new_address(request.uri().path()));
    let mut response = next.run(request).await;
    response.headers_mut().insert(DEPRECATION, DEPRECATED_SINCE);
    response.headers_mut().extend(HeaderValue::try_from(link).ok().map(|link| (header::LINK, link)));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_new_address_has_the_ids_of_the_old_one() {
        let path = "/sessions/{id}/edits/{edit}";
        let route = ReplacedRoute { path, new_path: format!("{path}/undo") };
        assert_eq!(route.new_address("/sessions/1/edits/2%20a"), "/api/v1/sessions/1/edits/2%20a/undo");
        let route = ReplacedRoute { path: "/audit", new_path: "/audit-entries".to_owned() };
        assert_eq!(route.new_address("/audit"), "/api/v1/audit-entries");
    }
}
