//! The table of trials, filtered and page by page.

use askama::Template;
use treewright_proto::v1;

use super::super::{Query, Visitor};
use super::{Head, PageFrame, TrialRow, head, render, row};
use crate::error::{Error, Result};
use crate::rpc;

const ROWS: i32 = 50;

#[derive(Template)]
#[template(path = "trials.html")]
struct Page {
    frame: PageFrame,
    head: Head,
    filter: String,
    order: String,
    problem: Option<String>,
    rows: Vec<TrialRow>,
    next: Option<String>,
}

/// The page, and whether its filter and order could be read.
pub(in super::super) async fn trials(
    visitor: &Visitor<'_>,
    id: &str,
    query: &Query,
) -> Result<(String, bool)> {
    let (head, _) = head(visitor, id, "trials").await?;
    query.only(&["filter", "order", "page"])?;
    let (filter, order) = (query.text("filter"), query.text("order"));
    let request = v1::QueryTrialsRequest {
        study: format!("studies/{}", head.id),
        filter: filter.clone(),
        order_by: if order.is_empty() { "number desc".to_owned() } else { order.clone() },
        page_size: ROWS,
        page_token: query.text("page"),
        in_present_space: false,
    };
    let (page, problem) = match rpc::trials::query(visitor.call(), request).await {
        Ok(page) => (page, None),
        // A mistake in a filter is shown beside it.
        Err(error @ Error::Invalid { .. }) => (v1::QueryTrialsResponse::default(), Some(error.to_string())),
        Err(error) => return Err(error),
    };
    let next = (!page.next_page_token.is_empty())
        .then(|| Query::written(&[("filter", &filter), ("order", &order), ("page", &page.next_page_token)]));
    let rows = page.trials.iter().map(|trial| row(trial, &head)).collect();
    let is_read = problem.is_none();
    Ok((render(&Page { frame: visitor.frame, head, filter, order, problem, rows, next })?, is_read))
}
