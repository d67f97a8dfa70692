//! Common parts of answers: JSON, pages of lists, times.

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize, Serializer};
use utoipa::{IntoParams, PartialSchema, ToSchema};

use super::error::ProblemResponse;
use super::read::Json;
use crate::store::{self, Cursor, PageRequest};
use crate::time::to_rfc3339;

impl<T: Serialize> IntoResponse for Json<T> {
    fn into_response(self) -> Response {
        axum::Json(self.0).into_response()
    }
}

/// A created resource and its address; answered with status 201.
pub struct Created<T> {
    /// Address of the resource.
    pub location: String,
    /// The resource.
    pub made: T,
}

impl<T: Serialize> IntoResponse for Created<T> {
    fn into_response(self) -> Response {
        (StatusCode::CREATED, [(axum::http::header::LOCATION, self.location)], Json(self.made)).into_response()
    }
}

/// A point in time: epoch milliseconds inside, RFC 3339 text in UTC outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time(pub i64);

impl Serialize for Time {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&to_rfc3339(self.0))
    }
}

impl PartialSchema for Time {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::schema::Schema> {
        use utoipa::openapi::schema::{KnownFormat, ObjectBuilder, SchemaFormat, Type};
        let text = ObjectBuilder::new().schema_type(Type::String);
        text.format(Some(SchemaFormat::KnownFormat(KnownFormat::DateTime))).into()
    }
}

impl ToSchema for Time {}

/// A reference to a resource, with its name and code.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct NamedReference {
    /// Id of the resource.
    pub id: String,
    /// Name for people.
    pub name: String,
    /// Short unique name.
    pub code: String,
}

/// Selects a page of a list.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Paging {
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

impl Paging {
    /// A page with at most `limit` items, after `cursor`.
    pub fn new(limit: Option<u32>, cursor: Option<String>) -> Self {
        Self { limit, cursor }
    }

    /// The requested limit, if there is one.
    pub fn limit(&self) -> Option<u32> {
        self.limit
    }

    /// Caps the requested limit at `most`.
    pub fn at_most(self, most: u32) -> Self {
        Self { limit: self.limit.map(|limit| limit.min(most)), ..self }
    }

    /// Checks limit and cursor and makes the store's page request. `list` is a name that no other list has, since only
    /// cursors of this list are accepted: the name of a resource's list ends with the resource's id. `usual` is the
    /// default limit.
    pub fn request(self, list: impl Into<String>, usual: u32) -> Result<PageRequest, ProblemResponse> {
        let limit = self.limit.unwrap_or(usual);
        if !(1..=PageRequest::MAX_LIMIT).contains(&limit) {
            return Err(ProblemResponse::invalid(
                "limit",
                format!("is {limit}; expected 1 to {}", PageRequest::MAX_LIMIT),
            ));
        }
        let list = list.into();
        let after = self.cursor.map(|cursor| Cursor::parse(&cursor, &list)).transpose();
        let after = after.map_err(|unusable| ProblemResponse::invalid("cursor", unusable))?;
        Ok(PageRequest::new(limit, after).of_list(list))
    }
}

/// A page of a list.
#[derive(Debug, Serialize, ToSchema)]
pub struct PageResponse<T> {
    /// The items.
    pub items: Vec<T>,
    /// `cursor` of the next page; `null` if this is the last page.
    pub next: Option<String>,
}

impl<T> PageResponse<T> {
    /// A page of the store, with each item converted by `show`.
    pub fn of<U>(page: store::Page<U>, show: impl FnMut(U) -> T) -> Self {
        let store::Page { items, next } = page.map(show);
        Self { items, next: next.map(|cursor| cursor.to_string()) }
    }

    /// The only page of a list that is always short.
    pub fn whole(items: impl IntoIterator<Item = T>) -> Self {
        Self { items: items.into_iter().collect(), next: None }
    }
}
