//! The descriptions for machines, `proto/openapi.yaml` and `proto/asyncapi.yaml`, against the
//! code: routes, kinds of problems, messages, close codes, and the fields of JSON.

#![allow(clippy::unwrap_used, reason = "this is test code")]

use std::collections::{BTreeMap, BTreeSet};
use std::iter::successors;
use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{
    Consistency, DistancePair, Input, Output, Quality, Registration, Residual, StageTimes,
    Statistics, Tracking,
};
use steadymesh_proto::stream::{
    Accepted, ControlMessage, DracoConfig, DropReason, EndReason, FrameState, MetricsMode,
    Overload, Problem, PublishReply, PublisherMessage, StreamConfig, StreamCounters, StreamList,
    StreamState, StreamSummary,
};

use steadymesh::webhooks::{Crossing, Details, Ending, Figure, Kind, Limit, Notice, Silence};

const METHODS: [&str; 8] = [
    "get", "put", "post", "delete", "patch", "head", "options", "trace",
];

fn read(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn openapi() -> Value {
    serde_yaml_ng::from_str(&read("proto/openapi.yaml")).unwrap()
}

fn asyncapi() -> Value {
    serde_yaml_ng::from_str(&read("proto/asyncapi.yaml")).unwrap()
}

/// What a reference within the document leads to; the value itself if it is none.
fn follow<'a>(document: &'a Value, value: &'a Value) -> &'a Value {
    let Some(reference) = value.get("$ref").and_then(Value::as_str) else {
        return value;
    };
    let target = document.pointer(reference.trim_start_matches('#'));
    target.unwrap_or_else(|| panic!("{reference} leads nowhere"))
}

/// The strings of a list, or the keys of an object.
fn names(value: &Value) -> BTreeSet<String> {
    match value {
        Value::Object(fields) => fields.keys().cloned().collect(),
        Value::Array(items) => {
            let texts = items.iter().map(|item| item.as_str().unwrap());
            texts.map(str::to_owned).collect()
        }
        _ => BTreeSet::new(),
    }
}

/// Fails with what only one of two sets has.
fn assert_same<T: Ord + std::fmt::Debug>(code: &BTreeSet<T>, described: &BTreeSet<T>) {
    let undescribed: Vec<_> = code.difference(described).collect();
    let invented: Vec<_> = described.difference(code).collect();
    assert!(
        undescribed.is_empty() && invented.is_empty(),
        "not described: {undescribed:#?}, described and not there: {invented:#?}"
    );
}

#[test]
fn both_descriptions_are_of_this_version() {
    for description in [openapi(), asyncapi()] {
        assert_eq!(description["info"]["version"], env!("CARGO_PKG_VERSION"));
    }
}

#[test]
fn every_reference_leads_somewhere() {
    let (openapi, asyncapi) = (openapi(), asyncapi());
    for (name, document) in [("openapi.yaml", &openapi), ("asyncapi.yaml", &asyncapi)] {
        for reference in references(document) {
            let (file, pointer) = reference.split_once('#').unwrap();
            let target = match file {
                "" => document.pointer(pointer),
                "openapi.yaml" => openapi.pointer(pointer),
                _ => None,
            };
            assert!(target.is_some(), "{name}: {reference} leads nowhere");
        }
    }
}

fn references(value: &Value) -> Vec<String> {
    match value {
        Value::Object(fields) => {
            let own = fields.get("$ref").and_then(Value::as_str);
            let inner = fields.values().flat_map(references);
            own.map(str::to_owned).into_iter().chain(inner).collect()
        }
        Value::Array(items) => items.iter().flat_map(references).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn every_route_is_described_and_no_other() {
    let mut served = routes("src/server/router.rs");
    served.append(&mut routes("src/server/internal.rs"));
    let mut described = BTreeSet::new();
    for (path, item) in openapi()["paths"].as_object().unwrap() {
        let methods = names(item).into_iter();
        let methods = methods.filter(|name| METHODS.contains(&name.as_str()));
        described.extend(methods.map(|method| (path.clone(), method)));
    }
    assert_same(&served, &described);
}

/// Paths and methods of the `.route("…", …)` calls in a source file.
fn routes(file: &str) -> BTreeSet<(String, String)> {
    let code = read(file);
    let mut routes = BTreeSet::new();
    for call in code.split(".route(").skip(1) {
        let (path, handler) = argument_list(call).split_once(',').unwrap();
        let path = path.trim().trim_matches('"');
        let handler = handler.trim().trim_end_matches(',');
        // What has a name is defined above.
        let definition = code.split_once(&format!("let {handler} ="));
        let handler = definition.map_or(handler, |(_, rest)| rest.split(';').next().unwrap());
        let methods = METHODS.iter().filter(|method| calls(handler, method));
        let methods: Vec<_> = methods.map(|method| (*method).to_owned()).collect();
        assert!(!methods.is_empty(), "{path} answers to nothing: {handler}");
        routes.extend(methods.into_iter().map(|method| (path.to_owned(), method)));
    }
    assert!(!routes.is_empty(), "{file} has no routes");
    routes
}

/// The text up to the parenthesis that closes the one before it.
fn argument_list(text: &str) -> &str {
    let mut depth = 1;
    for (at, character) in text.char_indices() {
        match character {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return &text[..at];
        }
    }
    panic!("a parenthesis is not closed: {text}")
}

/// Whether a function of this name is called.
fn calls(code: &str, name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut found = code.match_indices(name);
    found.any(|(at, _)| !code[..at].ends_with(is_part) && code[at + name.len()..].starts_with('('))
}

#[test]
fn every_kind_of_problem_is_described_and_no_other() {
    let code = read("src/server/error.rs");
    // The kind is the first text that `Problem::new` is given.
    let made = code.split("Self::new(").skip(1);
    let kinds = made.map(|call| call.split('"').nth(1).unwrap());
    let kinds: BTreeSet<_> = kinds
        .map(|kind| format!("urn:steadymesh:problem:{kind}"))
        .collect();
    let description = openapi();
    let described = &description["components"]["schemas"]["Problem"]["properties"]["type"]["enum"];
    assert_same(&kinds, &names(described));
}

#[test]
fn every_close_code_of_our_own_is_described_and_no_other() {
    let code = read("src/server/socket.rs");
    let constants = code.split("const CLOSE_").skip(1);
    let codes: BTreeSet<_> = constants
        .map(|constant| constant.split(['=', ';']).nth(1).unwrap().trim().to_owned())
        .collect();
    let description = asyncapi();
    let channels = description["channels"].as_object().unwrap().values();
    let described = channels.flat_map(|channel| names(&channel["x-close-codes"]));
    let own: BTreeSet<_> = described.filter(|code| code.starts_with('4')).collect();
    assert_same(&codes, &own);
}

// Each list of variants is made by a `match`, so that a new variant does not compile until it is
// in the list.

fn end_reasons() -> impl Iterator<Item = EndReason> {
    successors(Some(EndReason::Deleted), |reason| match reason {
        EndReason::Deleted => Some(EndReason::Idle),
        EndReason::Idle => Some(EndReason::Shutdown),
        EndReason::Shutdown => None,
    })
}

fn drop_reasons() -> impl Iterator<Item = DropReason> {
    successors(Some(DropReason::Overload), |reason| match reason {
        DropReason::Overload => Some(DropReason::Failed),
        DropReason::Failed => Some(DropReason::Ended),
        DropReason::Ended => None,
    })
}

fn frame_states() -> impl Iterator<Item = FrameState> {
    let (seq, reason) = (41, DropReason::Overload);
    let first = FrameState::Accepted { seq };
    successors(Some(first), move |state| match state {
        FrameState::Accepted { .. } => Some(FrameState::Duplicate { seq }),
        FrameState::Duplicate { .. } => Some(FrameState::Rejected { problem: problem() }),
        FrameState::Rejected { .. } => Some(FrameState::Published { seq }),
        FrameState::Published { .. } => Some(FrameState::Dropped { seq, reason }),
        FrameState::Dropped { .. } => None,
    })
}

fn control_messages() -> impl Iterator<Item = ControlMessage> {
    let hello = ControlMessage::Hello {
        protocol: steadymesh_proto::SUBPROTOCOL.to_owned(),
        stream: "demo".to_owned(),
        latest_seq: None,
        config: StreamConfig::default(),
    };
    let reason = EndReason::Deleted;
    successors(Some(hello), move |message| match message {
        ControlMessage::Hello { .. } => Some(ControlMessage::Skipped { missed: 3 }),
        ControlMessage::Skipped { .. } => Some(ControlMessage::End { reason }),
        ControlMessage::End { .. } => None,
    })
}

fn publish_replies() -> impl Iterator<Item = PublishReply> {
    let welcome = PublishReply::Welcome {
        protocol: steadymesh_proto::SUBPROTOCOL.to_owned(),
        stream: "demo".to_owned(),
        session: "6f0c".to_owned(),
        latest_seq: None,
        credit: 4,
        config: StreamConfig::default(),
    };
    let (message, seq) = (3, 41);
    successors(Some(welcome), move |reply| match reply {
        PublishReply::Welcome { .. } => Some(PublishReply::Credit { credit: 9 }),
        PublishReply::Credit { .. } => Some(PublishReply::Ack {
            message,
            state: FrameState::Accepted { seq },
        }),
        PublishReply::Ack { .. } => None,
    })
}

fn publisher_messages() -> impl Iterator<Item = PublisherMessage> {
    let frame = PublisherMessage::Frame {
        seq: Some(41),
        capture_time_us: Some(1_700_000_000_000_000),
    };
    successors(Some(frame), |message| match message {
        PublisherMessage::Frame { .. } => None,
    })
}

fn serialized<T: Serialize>(values: impl Iterator<Item = T>) -> Vec<Value> {
    values
        .map(|value| serde_json::to_value(value).unwrap())
        .collect()
}

#[test]
fn every_message_to_a_player_is_described_and_no_other() {
    assert_described("subscribe", &serialized(control_messages()));
    assert_reasons("End", &serialized(end_reasons()));
}

#[test]
fn every_message_of_publishing_is_described_and_no_other() {
    let acks = frame_states().map(|state| PublishReply::Ack { message: 3, state });
    let mut messages = serialized(publish_replies());
    messages.append(&mut serialized(acks));
    messages.append(&mut serialized(publisher_messages()));
    assert_described("publish", &messages);
    assert_reasons("AckDropped", &serialized(drop_reasons()));
}

/// Each message is one of those of the channel, and each of those has been seen.
fn assert_described(channel: &str, messages: &[Value]) {
    let description = asyncapi();
    let schemas = text_messages(&description, channel);
    let mut seen = BTreeSet::new();
    for message in messages {
        let fitting = schemas.iter().filter(|(_, schema)| fits(message, schema));
        let fitting: Vec<_> = fitting.map(|(name, _)| name.clone()).collect();
        assert_eq!(fitting.len(), 1, "{message} is described as {fitting:?}");
        seen.extend(fitting);
    }
    assert_same(&seen, &schemas.into_keys().collect());
}

/// A channel's messages in JSON, with their schemas.
fn text_messages<'a>(description: &'a Value, channel: &str) -> BTreeMap<String, &'a Value> {
    let messages = description["channels"][channel]["messages"].as_object();
    let schemas = messages.unwrap().iter().map(|(name, message)| {
        let payload = &follow(description, message)["payload"];
        (name.clone(), follow(description, payload))
    });
    schemas
        .filter(|(_, schema)| schema["type"] == "object")
        .collect()
}

/// Whether a message has the fields of a schema, and the values that are fixed there.
fn fits(message: &Value, schema: &Value) -> bool {
    let properties = schema["properties"].as_object().unwrap();
    let is_right = |(name, value): (&String, &Value)| {
        properties.get(name).is_some_and(|property| {
            let fixed = property.get("const");
            let allowed = property.get("enum").and_then(Value::as_array);
            fixed.is_none_or(|fixed| fixed == value)
                && allowed.is_none_or(|allowed| allowed.contains(value))
        })
    };
    names(&schema["required"]).is_subset(&names(message))
        && message.as_object().unwrap().iter().all(is_right)
}

fn assert_reasons(schema: &str, reasons: &[Value]) {
    let description = asyncapi();
    let described = &description["components"]["schemas"][schema]["properties"]["reason"]["enum"];
    assert_same(&names(&json!(reasons)), &names(described));
}

#[test]
fn the_metrics_of_a_frame_have_the_described_fields() {
    assert_fields("FrameMetrics", "properties", &metrics());
    assert_fields("FrameMetrics", "required", &FrameMetrics::default());
}

#[test]
fn the_documents_about_streams_have_the_described_fields() {
    assert_fields("StreamConfig", "properties", &config());
    assert_fields("StreamConfig", "required", &StreamConfig::default());
    let streams = vec![summary()];
    assert_fields("StreamList", "properties", &StreamList { streams });
}

#[test]
fn answers_have_the_described_fields() {
    let accepted = |duplicate| Accepted {
        seq: 41,
        queued: 2,
        duplicate,
    };
    assert_fields("Accepted", "properties", &accepted(true));
    assert_fields("Accepted", "required", &accepted(false));
    assert_fields("Problem", "properties", &problem());
    let final_problem = Problem {
        retry_after_ms: None,
        ..problem()
    };
    assert_fields("Problem", "required", &final_problem);
}

#[test]
fn every_webhook_is_described_and_no_other() {
    let description = openapi();
    let mut told = BTreeSet::new();
    for notice in notices() {
        let notice = serde_json::to_value(notice).unwrap();
        let kind = notice["type"].as_str().unwrap().to_owned();
        let operation = &description["webhooks"][&kind]["post"];
        let body = &operation["requestBody"]["content"]["application/json"]["schema"];
        let schema = follow(&description, body);
        assert!(
            names(&schema["properties"]["type"]["enum"]).contains(&kind),
            "{kind}"
        );
        let data = &schema["properties"]["data"];
        assert_eq!(names(&notice["data"]), names(&data["properties"]), "{kind}");
        assert_eq!(
            names(&data["properties"]),
            names(&data["required"]),
            "{kind}"
        );
        told.insert(kind);
    }
    assert_same(&told, &names(&description["webhooks"]));
    let figures = &description["components"]["schemas"]["FigureCrossed"]["properties"]["data"];
    assert_same(
        &names(&json!(serialized(figures_in_turn()))),
        &names(&figures["properties"]["figure"]["enum"]),
    );
}

fn notices() -> impl Iterator<Item = Notice> {
    let kinds = successors(Some(Kind::Started), |kind| match kind {
        Kind::Started => Some(Kind::Ended),
        Kind::Ended => Some(Kind::Stalled),
        Kind::Stalled => Some(Kind::Resumed),
        Kind::Resumed => Some(Kind::Exceeded),
        Kind::Exceeded => Some(Kind::Restored),
        Kind::Restored => None,
    });
    kinds.map(|kind| Notice {
        r#type: kind,
        timestamp: std::time::SystemTime::UNIX_EPOCH,
        data: details(kind),
    })
}

fn details(kind: Kind) -> Details {
    let (stream, seq) = ("demo".to_owned(), 41);
    match kind {
        Kind::Started => Details::Started { stream, seq },
        Kind::Ended => Details::Ended(Ending {
            stream,
            reason: EndReason::Idle,
            published: 42,
            dropped: 0,
            latest_seq: Some(seq),
        }),
        Kind::Stalled | Kind::Resumed => Details::Silence(Silence {
            stream,
            seq,
            silent_secs: 5.0,
        }),
        Kind::Exceeded | Kind::Restored => Details::Crossing(Crossing {
            stream,
            seq,
            figure: Figure::Flicker,
            value: 0.02,
            bound: Limit::Max(0.01),
            frames: 15,
        }),
    }
}

fn figures_in_turn() -> impl Iterator<Item = Figure> {
    successors(
        Some(Figure::SurfaceDistancePrevious),
        |figure| match figure {
            Figure::SurfaceDistancePrevious => Some(Figure::SurfaceDistanceCurrent),
            Figure::SurfaceDistanceCurrent => Some(Figure::RegistrationResidual),
            Figure::RegistrationResidual => Some(Figure::VertexPersistence),
            Figure::VertexPersistence => Some(Figure::Flicker),
            Figure::Flicker => None,
        },
    )
}

/// The fields that `value` is written with are those that its schema lists under `list`:
/// `properties` for a value that has everything, `required` for one that has only what must be.
fn assert_fields(schema: &str, list: &str, value: &impl Serialize) {
    let description = openapi();
    let described = &description["components"]["schemas"][schema];
    let written = serde_json::to_value(value).unwrap();
    assert_object(&description, (described, list), &written, schema);
}

fn assert_object(description: &Value, (schema, list): (&Value, &str), value: &Value, at: &str) {
    let schema = not_null(description, schema);
    match value {
        Value::Object(fields) => {
            assert_eq!(names(value), names(&schema[list]), "{list} of {at}");
            for (name, value) in fields {
                let (property, at) = (&schema["properties"][name], format!("{at}.{name}"));
                assert_object(description, (property, list), value, &at);
            }
        }
        Value::Array(items) => {
            for item in items {
                assert_object(description, (&schema["items"], list), item, at);
            }
        }
        _ => {}
    }
}

/// What a schema says of values that are not null.
fn not_null<'a>(description: &'a Value, schema: &'a Value) -> &'a Value {
    let schema = follow(description, schema);
    let alternatives = schema.get("oneOf").and_then(Value::as_array);
    let mut alternatives = alternatives.into_iter().flatten();
    alternatives
        .find(|alternative| alternative.get("$ref").is_some())
        .map_or(schema, |alternative| follow(description, alternative))
}

// Values that leave nothing out. All fields are named, so that a new one does not compile until it
// is here.

fn metrics() -> FrameMetrics {
    let pair = DistancePair {
        previous: Some(Statistics::default()),
        current: Statistics::default(),
    };
    FrameMetrics {
        seq: 41,
        capture_time_us: Some(1_700_000_000_000_000),
        tracking: Tracking::Paper,
        quality: Quality::Sampled,
        reference_seq: Some(40),
        input: Input::default(),
        output: Output::default(),
        registration: Some(Registration {
            rigid_rmse: 0.1,
            residual: Residual::default(),
            nodes: 146,
            iterations: 9,
        }),
        registration_error: Some("none, this is a test".to_owned()),
        reset: Some("registration failed".to_owned()),
        surface_distance: Some(pair.clone()),
        vertex_distance: Some(pair),
        current_to_output: Some(Statistics::default()),
        consistency: Some(Consistency::default()),
        bbox_diagonal: 2.0,
        stage_us: StageTimes::default(),
        latency_us: 85_000,
    }
}

fn config() -> StreamConfig {
    StreamConfig {
        target_faces: Some(4000),
        target_ratio: Some(0.1),
        tracking: Some(Tracking::Robust),
        tracking_strength: Some(0.5),
        draco: DracoConfig {
            position_bits: Some(12),
            speed: Some(5),
        },
        metrics: Some(MetricsMode::Full),
        overload: Some(Overload::Lossless),
    }
}

fn summary() -> StreamSummary {
    StreamSummary {
        stream: "demo".to_owned(),
        state: StreamState::Live,
        config: config(),
        counters: StreamCounters::default(),
        subscribers: 2,
        queued: 1,
        latest_seq: Some(40),
        created_us: 1_700_000_000_000_000,
    }
}

fn problem() -> Problem {
    Problem {
        r#type: "urn:steadymesh:problem:queue-full".to_owned(),
        title: "The stream's queue is full".to_owned(),
        status: 429,
        detail: "frames come faster than they are processed".to_owned(),
        retry_after_ms: Some(100),
    }
}
