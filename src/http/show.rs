//! What answers have in common: JSON, pages of lists, times.

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize, Serializer};
use utoipa::{IntoParams, PartialSchema, ToSchema};

use super::error::Problem;
use super::read::Json;
use crate::store::{self, PageRequest};
use crate::time::to_rfc3339;

impl<T: Serialize> IntoResponse for Json<T> {
    fn into_response(self) -> Response {
        axum::Json(self.0).into_response()
    }
}

/// What was made, and where it is.
pub struct Created<T> {
    /// Its address.
    pub location: String,
    /// Itself.
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

/// A thing that another one refers to.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Named {
    /// Its id.
    pub id: String,
    /// What people call it.
    pub name: String,
    /// Its short unique name.
    pub code: String,
}

/// Which part of a list.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Paging {
    /// Most items of the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// Longest cursor: the longest name that a list is sorted by.
const MAX_CURSOR: usize = 512;

impl Paging {
    /// Checks the limit; `usual` items when none is named.
    pub fn new(limit: Option<u32>, cursor: Option<String>) -> Self {
        Self { limit, cursor }
    }

    /// The limit that was asked for, if one was.
    pub fn limit(&self) -> Option<u32> {
        self.limit
    }

    /// The same with no more items than these.
    pub fn at_most(self, most: u32) -> Self {
        Self { limit: self.limit.map(|limit| limit.min(most)), ..self }
    }

    /// What the store understands.
    pub fn request(self, usual: u32) -> Result<PageRequest, Problem> {
        let limit = self.limit.unwrap_or(usual);
        if !(1..=PageRequest::MOST).contains(&limit) {
            return Err(Problem::invalid("limit", format!("is {limit}; expected 1 to {}", PageRequest::MOST)));
        }
        if self.cursor.as_ref().is_some_and(|cursor| cursor.len() > MAX_CURSOR) {
            return Err(Problem::invalid("cursor", "is none of ours; use `next` of the page before"));
        }
        Ok(PageRequest::new(limit, self.cursor))
    }
}

/// Part of a list.
#[derive(Debug, Serialize, ToSchema)]
pub struct Page<T> {
    /// The items.
    pub items: Vec<T>,
    /// `cursor` of the next page; `null` if this is the last.
    pub next: Option<String>,
}

impl<T> Page<T> {
    /// A page of the store, each item as it is shown.
    pub fn of<U>(page: store::Page<U>, show: impl FnMut(U) -> T) -> Self {
        let store::Page { items, next } = page.map(show);
        Self { items, next }
    }

    /// A list that is short by its nature.
    pub fn whole(items: impl IntoIterator<Item = T>) -> Self {
        Self { items: items.into_iter().collect(), next: None }
    }
}
