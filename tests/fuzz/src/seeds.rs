//! First inputs: a valid one of each kind, so that a fuzzer need not find the grammar first.

use std::collections::BTreeMap;

use prost::Message;
use treewright_proto::v1::{self as wire, outcome};

use crate::example;
use crate::requests::Kind;

/// An input: its target, its name, its bytes.
pub type Seed = (&'static str, String, Vec<u8>);

/// All seeds.
#[must_use]
pub fn all() -> Vec<Seed> {
    let mut seeds = Vec::new();
    for (number, (kind, message)) in requests().into_iter().enumerate() {
        seeds.push(("requests", format!("{number:02}"), [&[kind as u8], message.as_slice()].concat()));
    }
    let study = example::study().encode_to_vec();
    for (name, costs) in
        [("plain", [20, 21, 22, 23, 24, 25, 26, 27]), ("odd", [0, 255, 127, 128, 1, 254, 7, 63])]
    {
        seeds.push(("studies", name.to_owned(), [costs.as_slice(), &study].concat()));
    }
    let mut models = example::study();
    if let Some(policy) = &mut models.policy {
        policy.search = wire::SearchMethod::Model as i32;
        policy.predictor = wire::PredictorMethod::Auto as i32;
        policy.regret_budget = Some(0.05);
        policy.lease_s = 10;
    }
    seeds.push(("studies", "models".to_owned(), [[9; 8].as_slice(), &models.encode_to_vec()].concat()));
    for (number, text) in FILTERS.iter().enumerate() {
        seeds.push(("filters", format!("{number:02}"), text.as_bytes().to_vec()));
    }
    for (number, text) in ARGUMENTS.iter().enumerate() {
        seeds.push(("arguments", format!("{number:02}"), text.as_bytes().to_vec()));
    }
    for (number, text) in PRINTED.iter().enumerate() {
        seeds.push(("printed", format!("{number:02}"), text.as_bytes().to_vec()));
    }
    for (name, kind, text) in SCENES {
        seeds.push(("scenes", name.to_owned(), [&[kind], text.as_bytes()].concat()));
    }
    seeds.push(("scenes", "binary".to_owned(), [&[0], glb().as_slice()].concat()));
    seeds
}

fn requests() -> Vec<(Kind, Vec<u8>)> {
    let study = || "studies/s".to_owned();
    let trial = || "studies/s/trials/1".to_owned();
    let indicators = || BTreeMap::from([("i".to_owned(), 0.5)]);
    let report = |kind| wire::ReportRequest {
        trial: trial(),
        measurements: BTreeMap::from([("m".to_owned(), 3.5)]),
        outcome: Some(wire::Outcome { kind: Some(kind) }),
        ..wire::ReportRequest::default()
    };
    let update = wire::UpdateStudyRequest {
        study: Some(wire::Study { name: study(), ..example::study() }),
        update_mask: Some(prost_types::FieldMask { paths: vec!["policy.epsilon".to_owned()] }),
    };
    let query = wire::QueryTrialsRequest {
        study: study(),
        filter: "state = COMPLETED AND cost < 5".to_owned(),
        order_by: "cost desc".to_owned(),
        page_size: 10,
        ..Default::default()
    };
    let other = wire::CreateStudyRequest { study_id: "other".to_owned(), study: Some(example::study()) };
    let rename = wire::RenameStudyRequest { name: study(), study_id: "renamed".to_owned() };
    let change = wire::ChangeSpaceRequest {
        name: study(),
        revision: 1,
        space: example::study().space,
        ..Default::default()
    };
    let reason = "disturbed".to_owned();
    let exclude = wire::ExcludeTrialRequest { trial: trial(), reason, include: false };
    let identified = "studies/s@0123456789abcdef/trials/1".to_owned();
    vec![
        (Kind::CreateStudy, other.encode_to_vec()),
        (Kind::GetStudy, wire::GetStudyRequest { name: study() }.encode_to_vec()),
        (Kind::ListStudies, wire::ListStudiesRequest { page_size: 3, ..Default::default() }.encode_to_vec()),
        (Kind::UpdateStudy, update.encode_to_vec()),
        (Kind::DeleteStudy, wire::DeleteStudyRequest { name: "studies/other".to_owned() }.encode_to_vec()),
        (Kind::Suggest, example::suggest("d").encode_to_vec()),
        (
            Kind::Suggest,
            wire::SuggestRequest { session: 7, can_abort: true, ..example::suggest("c") }.encode_to_vec(),
        ),
        (Kind::Report, report(outcome::Kind::Ok(wire::Ok {})).encode_to_vec()),
        (Kind::Report, report(outcome::Kind::Aborted(wire::Aborted { lower_bound: 9.0 })).encode_to_vec()),
        (
            Kind::Predict,
            wire::PredictRequest { study: study(), indicators: indicators(), ..Default::default() }
                .encode_to_vec(),
        ),
        (Kind::AbandonTrial, wire::AbandonTrialRequest { trial: trial() }.encode_to_vec()),
        (Kind::ExtendLease, wire::ExtendLeaseRequest { trial: trial() }.encode_to_vec()),
        (Kind::QueryTrials, query.encode_to_vec()),
        (Kind::GetBest, wire::GetBestRequest { study: study(), ..Default::default() }.encode_to_vec()),
        (Kind::GetTrial, wire::GetTrialRequest { name: trial() }.encode_to_vec()),
        (Kind::GetTrial, wire::GetTrialRequest { name: identified }.encode_to_vec()),
        (Kind::RenameStudy, rename.encode_to_vec()),
        (Kind::ChangeSpace, change.encode_to_vec()),
        (Kind::ExcludeTrial, exclude.encode_to_vec()),
    ]
}

/// One of each construct of the filter language, of orders and of page tokens.
const FILTERS: [&str; 10] = [
    "state = COMPLETED",
    "cost < 5.5 AND mode != EXPLORE AND late = true",
    "config.a >= 3 AND config.q = \"low\"",
    "indicator.i > 0.25 AND outcome = ABORTED",
    "measurement.m <= 1e-3",
    "client_id = \"renderer-1\" AND number != 12",
    "state_id = 3 AND config.f < -2.5e2",
    "cost desc",
    "measurement.m desc",
    "number",
];

/// Command lines of the daemon.
const ARGUMENTS: [&str; 6] = [
    "serve --database /tmp/x.db",
    "serve --database postgres://anna@127.0.0.1/farm --database-wait-s 3 --advertise http://10.0.0.7:50611",
    "serve --database x.db --insecure --metrics 127.0.0.1:9464 --log debug",
    "token create --database x.db --name hall --read --study hall",
    "token list --database x.db --json",
    "--help",
];

/// Outputs of programs: one line an epoch, pretty, words in place of numbers, names and braces of other
/// kinds.
const PRINTED: [&str; 8] = [
    "{\"epoch\": 1, \"loss\": 0.25}\n{\"epoch\": 2, \"loss\": NaN}\n",
    "10 %\r20 %\r{\"loss\": 1.5e-3}\r\n",
    "{\n  \"loss\": 0.5,\n  \"of\": {\n    \"a\": [1, -inf]\n  }\n}\n",
    "\u{feff}{\"infeasible\": \"too \\\"deep\\\"\"}\n",
    "{ loss: 0.5, p99-ms: undefined }\n{worker 3} ends\n",
    "{\"loss\": 1, \"Throughput\": 3, \"cpu.user\": -1, \"best\": null, \"wall_ms\": 1e400}",
    "{'loss': None}\n}\n",
    "{\"loss\": 0.2",
];

/// Small scenes of each text format.
const SCENES: [(&str, u8, &str); 5] = [
    (
        "animated",
        1,
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0,"skin":0},{"children":[2]},{"translation":[0,0.5,0]}],"meshes":[{"weights":[0.5],"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2},"targets":[{"POSITION":0}]}]}],"skins":[{"joints":[1,2]}],"animations":[{"name":"walk","channels":[{"sampler":0,"target":{"node":1,"path":"translation"}},{"sampler":1,"target":{"node":2,"path":"rotation"}},{"sampler":2,"target":{"node":0,"path":"weights"}}],"samplers":[{"input":3,"output":4,"interpolation":"STEP"},{"input":3,"output":5},{"input":3,"output":6,"interpolation":"CUBICSPLINE"}]}],"buffers":[{"byteLength":184,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAABAAABAAAAAACAPwAAAAAAAAAAAAAAAAAAAD8AAAA/AAAAAAAAAAAAAIA/AAAAAAAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAABAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAIA/AAAAAAAAAADzBDU/8wQ1PwAAAAAAAAAAAAAAAAAAAAAAAIA/AAAAAA=="}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":12},{"buffer":0,"byteOffset":48,"byteLength":48},{"buffer":0,"byteOffset":96,"byteLength":8},{"buffer":0,"byteOffset":104,"byteLength":24},{"buffer":0,"byteOffset":128,"byteLength":32},{"buffer":0,"byteOffset":160,"byteLength":24}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},{"bufferView":1,"componentType":5121,"count":3,"type":"VEC4"},{"bufferView":2,"componentType":5126,"count":3,"type":"VEC4"},{"bufferView":3,"componentType":5126,"count":2,"type":"SCALAR"},{"bufferView":4,"componentType":5126,"count":2,"type":"VEC3"},{"bufferView":5,"componentType":5126,"count":2,"type":"VEC4"},{"bufferView":6,"componentType":5126,"count":6,"type":"SCALAR"}]}"#,
    ),
    (
        "text",
        1,
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]}"#,
    ),
    (
        "textured",
        1,
        r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_texture_transform","KHR_materials_transmission","KHR_materials_volume"],"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],"materials":[{"alphaMode":"MASK","alphaCutoff":0.4,"normalTexture":{"index":0,"scale":0.5},"emissiveTexture":{"index":0},"emissiveFactor":[1,1,1],"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"rotation":1.5,"scale":[2,2]}}},"metallicRoughnessTexture":{"index":0}},"extensions":{"KHR_materials_transmission":{"transmissionFactor":0.5},"KHR_materials_volume":{"thicknessFactor":1,"attenuationDistance":2,"attenuationColor":[1,0.5,0.5]}}}],"samplers":[{"wrapS":33071,"wrapT":33648}],"textures":[{"source":0,"sampler":0}],"images":[{"uri":"data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="}],"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAgD8AAIA/AACAPwAAAAAAAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}]}"#,
    ),
    (
        "polygons",
        2,
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ),
    (
        "wavefront",
        3,
        "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 1\nvt 0 0\nusemtl m\nf 1//1 2//1 3//1\nf 2 4 -2\n",
    ),
];

/// A triangle as binary glTF: a header, a chunk of JSON, a chunk of numbers (glTF 2.0 specification, section
/// 4.4).
fn glb() -> Vec<u8> {
    let mut json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"byteLength":36}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]}"#.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let positions: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let numbers: Vec<u8> = positions.iter().flat_map(|number| number.to_le_bytes()).collect();
    let word = |number: usize| (number as u32).to_le_bytes();
    let length = word(12 + 8 + json.len() + 8 + numbers.len());
    [
        b"glTF".as_slice(),
        &word(2),
        &length,
        &word(json.len()),
        b"JSON",
        &json,
        &word(numbers.len()),
        b"BIN\0",
        &numbers,
    ]
    .concat()
}
