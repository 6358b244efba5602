//! Whether a request may do what it asks for.

use std::time::{Duration, SystemTime};

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::streams::StreamName;

use super::App;
use super::auth::{Claim, Credential, Denied, Grant, Scope, TICKET_LIFETIME};
use super::error::Problem;
use super::extract::{JsonBody, NoParameters, Strict};

/// A clock that is set is noticed within this time.
const LOOK_AGAIN: Duration = Duration::from_secs(10);

/// A request that has been let in, and for how long.
#[derive(Debug, Default)]
pub(super) struct Access {
    expires: Option<SystemTime>,
    ticket: Option<Claim>,
}

impl Access {
    /// What was asked for has begun: a ticket is used up.
    pub fn begin(&mut self) {
        if let Some(ticket) = self.ticket.take() {
            ticket.use_up();
        }
    }

    /// Waits until the credential has expired, which many never do.
    pub async fn expired(&self) {
        let Some(expires) = self.expires else {
            return std::future::pending().await;
        };
        while let Ok(left) = expires.duration_since(SystemTime::now()) {
            tokio::time::sleep(left.min(LOOK_AGAIN) + Duration::from_millis(1)).await;
        }
    }
}

impl App {
    /// Lets a request in that is about one stream.
    ///
    /// # Errors
    ///
    /// 401 and 403.
    pub fn authorize(
        &self,
        credential: &Credential,
        scope: Scope,
        stream: &StreamName,
    ) -> Result<Access, Problem> {
        let Some((grant, ticket)) = self.granted(credential)? else {
            return Ok(Access::default());
        };
        let checked = grant.check(scope, stream);
        checked.map_err(|denied| self.denied(&denied))?;
        Ok(Access {
            expires: grant.expires,
            ticket,
        })
    }

    /// Whether everybody may do everything.
    pub fn is_open(&self) -> bool {
        self.options().auth.is_open()
    }

    /// What a credential opens; none if everything is open.
    ///
    /// # Errors
    ///
    /// 401.
    pub fn grant(&self, credential: &Credential) -> Result<Option<Grant>, Problem> {
        Ok(self.granted(credential)?.map(|(grant, _)| grant))
    }

    fn granted(&self, credential: &Credential) -> Result<Option<(Grant, Option<Claim>)>, Problem> {
        let auth = self.auth.load();
        let grant = auth.grant(credential, &self.tickets, SystemTime::now());
        grant.map_err(|denied| self.denied(&denied))
    }

    fn denied(&self, denied: &Denied) -> Problem {
        self.telemetry.count_denied(match denied {
            Denied::Missing => "missing",
            Denied::Unknown => "unknown",
            Denied::Expired => "expired",
            Denied::Scope { .. } => "scope",
            Denied::Stream { .. } => "stream",
        });
        let detail = denied.to_string();
        match denied {
            Denied::Missing | Denied::Unknown | Denied::Expired => Problem::unauthorized(detail),
            Denied::Scope { .. } | Denied::Stream { .. } => Problem::forbidden(detail),
        }
    }
}

/// What a ticket is wanted for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TicketRequest {
    stream: String,
    scope: Scope,
}

#[derive(Debug, Serialize)]
struct TicketAnswer {
    ticket: String,
    expires_in: u64,
}

/// `POST /v1/tickets`: a page that has a token gets a ticket to put into a WebSocket's address.
pub(super) async fn post_ticket(
    State(app): State<Arc<App>>,
    credential: Credential,
    Strict(NoParameters {}): Strict<NoParameters>,
    JsonBody(request): JsonBody<TicketRequest>,
) -> Result<Response, Problem> {
    let stream = StreamName::parse(&request.stream)?;
    let grant = app.grant(&credential)?.ok_or_else(|| {
        Problem::bad_request("this server wants no tokens: connect without a ticket")
    })?;
    let checked = grant.check(request.scope, &stream);
    checked.map_err(|denied| app.denied(&denied))?;
    // For this stream and scope only, and no longer than the token.
    let grant = Grant {
        scopes: vec![request.scope],
        streams: vec![stream.into()],
        ..grant
    };
    let mut random = [0; 16];
    getrandom::fill(&mut random)
        .map_err(|_| Problem::defect("the system has no random numbers to give"))?;
    let ticket = app.tickets.issue(grant, random, SystemTime::now());
    let ticket = ticket.ok_or_else(|| {
        Problem::over_limit("too many tickets are out that nobody has used: try again in a moment")
    })?;
    let expires_in = TICKET_LIFETIME.as_secs();
    let answer = Json(TicketAnswer { ticket, expires_in });
    Ok((
        StatusCode::CREATED,
        [(header::CACHE_CONTROL, "no-store")],
        answer,
    )
        .into_response())
}
