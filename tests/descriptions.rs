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
    Statistics, Texture, Tracking,
};
use steadymesh_proto::recording::{
    Gap, PlayerMessage, Record, RecordedFrame, RecordedFrames, RecordingList, RecordingState,
    RecordingSummary, Track, TrackSummary,
};
use steadymesh_proto::stream::{
    Accepted, ControlMessage, DracoConfig, DropReason, EndReason, FrameState, MetricsMode,
    Overload, Problem, PublishReply, PublisherMessage, RecordingStatus, StreamConfig,
    StreamCounters, StreamList, StreamState, StreamSummary, TextureConfig, TextureFormat,
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

/// Paths and methods that the `router` of a source file answers to.
fn routes(file: &str) -> BTreeSet<(String, String)> {
    let code = read(file);
    let routes = routes_of(function(&code, "router"), &code, "");
    assert!(!routes.is_empty(), "{file} has no routes");
    routes
}

/// Those of the `.route("…", …)` calls in the body of a function, under a path, and of the routers
/// that it puts under paths of their own: `.nest("…", other_function())`.
fn routes_of(body: &str, code: &str, under: &str) -> BTreeSet<(String, String)> {
    let mut routes = BTreeSet::new();
    for call in body.split(".route(").skip(1) {
        let (path, handler) = path_and_rest(call);
        // What has a name is defined above.
        let definition = body.split_once(&format!("let {handler} ="));
        let handler = definition.map_or(handler, |(_, rest)| rest.split(';').next().unwrap());
        let methods = METHODS.iter().filter(|method| calls(handler, method));
        let methods: Vec<_> = methods.map(|method| (*method).to_owned()).collect();
        assert!(!methods.is_empty(), "{path} answers to nothing: {handler}");
        // What is nested at a path answers to the path itself, without a slash behind it.
        let path = match path {
            "/" if !under.is_empty() => under.to_owned(),
            _ => format!("{under}{path}"),
        };
        routes.extend(methods.into_iter().map(|method| (path.clone(), method)));
    }
    for call in body.split(".nest(").skip(1) {
        let (path, router) = path_and_rest(call);
        let nested = function(code, router.trim_end_matches("()"));
        routes.append(&mut routes_of(nested, code, &format!("{under}{path}")));
    }
    routes
}

/// The two arguments of a call, the first of which is a text.
fn path_and_rest(call: &str) -> (&str, &str) {
    let (path, rest) = argument_list(call).split_once(',').unwrap();
    let rest = rest.trim().trim_end_matches(',');
    (path.trim().trim_matches('"'), rest)
}

/// The text of a function, up to the brace that stands at the beginning of a line.
fn function<'a>(code: &'a str, name: &str) -> &'a str {
    let definition = code.split_once(&format!("fn {name}("));
    let (_, rest) = definition.unwrap_or_else(|| panic!("there is no function {name}"));
    rest.split("\n}").next().unwrap()
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
        EndReason::Shutdown => Some(EndReason::Finished),
        EndReason::Finished => None,
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

fn player_messages() -> impl Iterator<Item = PlayerMessage> {
    let seek = |seq, time_us| PlayerMessage::Seek { seq, time_us };
    successors(Some(seek(Some(41), None)), move |message| match message {
        PlayerMessage::Seek { seq: Some(_), .. } => Some(seek(None, Some(1_700_000_000_000_000))),
        PlayerMessage::Seek { seq: None, .. } => Some(PlayerMessage::Speed { speed: 0.5 }),
        PlayerMessage::Speed { .. } => Some(PlayerMessage::Pause {}),
        PlayerMessage::Pause {} => Some(PlayerMessage::Resume {}),
        PlayerMessage::Resume {} => None,
    })
}

fn records() -> impl Iterator<Item = Record> {
    successors(Some(Record::Off), |record| match record {
        Record::Off => Some(Record::Raw),
        Record::Raw => Some(Record::Output),
        Record::Output => Some(Record::Both),
        Record::Both => None,
    })
}

fn recording_states() -> impl Iterator<Item = RecordingState> {
    successors(Some(RecordingState::Recording), |state| match state {
        RecordingState::Recording => Some(RecordingState::Complete),
        RecordingState::Complete => Some(RecordingState::Interrupted),
        RecordingState::Interrupted => None,
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

#[test]
fn every_message_of_playing_is_described_and_no_other() {
    // Whoever plays a recording gets all of it, however slow.
    let told = control_messages().filter(|message| match message {
        ControlMessage::Hello { .. } | ControlMessage::End { .. } => true,
        ControlMessage::Skipped { .. } => false,
    });
    let mut messages = serialized(told);
    messages.append(&mut serialized(player_messages()));
    assert_described("play", &messages);
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
    let streams = vec![StreamSummary {
        config: without_target(),
        recording: None,
        ..summary()
    }];
    assert_fields("StreamList", "required", &StreamList { streams });
    let status = RecordingStatus {
        failing: None,
        ..status()
    };
    assert_fields("RecordingStatus", "required", &status);
}

#[test]
fn the_documents_about_recordings_have_the_described_fields() {
    let recordings = vec![recording()];
    assert_fields("RecordingList", "properties", &RecordingList { recordings });
    let recordings = vec![RecordingSummary {
        config: without_target(),
        ..recording()
    }];
    assert_fields("RecordingList", "required", &RecordingList { recordings });
    for list in ["properties", "required"] {
        assert_fields("RecordedFrames", list, &recorded_frames());
    }
}

#[test]
fn every_word_about_recordings_is_described_and_no_other() {
    let description = openapi();
    let described = |schema: &str| names(&description["components"]["schemas"][schema]["enum"]);
    let words = |words: Vec<Value>| names(&Value::Array(words));
    assert_same(&words(serialized(records())), &described("Record"));
    assert_same(
        &words(serialized(Track::ALL.into_iter())),
        &described("Track"),
    );
    assert_same(
        &words(serialized(recording_states())),
        &described("RecordingState"),
    );
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
        texture: Some(Texture {
            id: "00112233445566778899aabbccddeeff".to_owned(),
            media_type: "image/jpeg".to_owned(),
            bytes: 241_000,
            width: 2048,
            height: 2048,
            encoded: true,
        }),
        texture_error: Some("image/png: cut off".to_owned()),
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
        attribute_weight: Some(0.01),
        draco: DracoConfig {
            position_bits: Some(12),
            speed: Some(5),
            texture_coordinate_bits: Some(12),
            normal_bits: Some(8),
        },
        texture: TextureConfig {
            format: Some(TextureFormat::Jpeg),
            quality: Some(85),
            max_size: Some(1024),
        },
        metrics: Some(MetricsMode::Full),
        overload: Some(Overload::Lossless),
        record: Some(Record::Both),
    }
}

/// Of the two targets one is there, and none in every case; and images need not have a limit.
fn without_target() -> StreamConfig {
    StreamConfig {
        target_faces: None,
        target_ratio: None,
        texture: TextureConfig {
            max_size: None,
            ..config().texture
        },
        ..config()
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
        recording: Some(status()),
    }
}

fn status() -> RecordingStatus {
    RecordingStatus {
        id: "20261129T215703Z-3f9a".to_owned(),
        frames: 41,
        lost_frames: 2,
        failing: Some("no space is left".to_owned()),
    }
}

fn recording() -> RecordingSummary {
    let track = TrackSummary {
        frames: 40,
        bytes: 412_000,
        segments: 2,
        first_seq: Some(0),
        last_seq: Some(41),
        first_time_us: Some(1_700_000_000_000_000),
        last_time_us: Some(1_700_000_001_366_653),
        gaps: vec![Gap {
            first_seq: 20,
            last_seq: 21,
            frames: 2,
        }],
    };
    RecordingSummary {
        stream: "demo".to_owned(),
        id: "20261129T215703Z-3f9a".to_owned(),
        state: RecordingState::Complete,
        started_us: 1_700_000_000_000_000,
        ended_us: Some(1_700_000_001_400_000),
        config: config(),
        raw: Some(track.clone()),
        output: Some(track),
    }
}

fn recorded_frames() -> RecordedFrames {
    let frame = RecordedFrame {
        seq: 41,
        capture_time_us: Some(1_700_000_000_000_000),
        stored_us: 1_700_000_000_085_000,
        content_type: steadymesh_proto::DELIVERED_CONTENT_TYPE.to_owned(),
        bytes: 8314,
    };
    RecordedFrames {
        frames: vec![frame],
        more: true,
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
