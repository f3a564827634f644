//! Changes to inputs: those of JSON keep to its grammar, and the first two bytes mean something.

use serde_json::{Map, Number, Value};

/// Numbers at the edge.
const NUMBERS: [f64; 24] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    3.0,
    7.0,
    1e-6,
    1e-30,
    5e-324,
    1e9,
    1e12,
    1e30,
    1e200,
    1.797e308,
    -1e12,
    -1e308,
    255.0,
    65_535.0,
    65_536.0,
    2_147_483_648.0,
    4_294_967_295.0,
    1.844_674_407_370_955_2e19,
];

/// Words that files may hold: fields and values of the formats, ways out of folders, what terminals obey.
const WORDS: [&str; 100] = [
    "",
    ".",
    "..",
    "/",
    "../x",
    "a/../b",
    "./images/0.png",
    "\n",
    "\u{1b}[2J",
    "\u{0}",
    "é",
    "NaN",
    "w",
    "h",
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "k1",
    "k2",
    "k3",
    "k4",
    "k5",
    "k6",
    "p1",
    "p2",
    "camera_angle_x",
    "camera_angle_y",
    "x_fov",
    "y_fov",
    "is_fisheye",
    "camera_model",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "PINHOLE",
    "RADIAL",
    "frames",
    "file_path",
    "transform_matrix",
    "time",
    "near",
    "far",
    "exposures",
    "mask_path",
    "depth_file_path",
    "depth_path",
    "transient_mask_path",
    "moving_path",
    "flow_path",
    "flow_valid_path",
    "flow_to",
    "aabb_scale",
    "scale",
    "offset",
    "sharpness",
    "applied_scale",
    "applied_transform",
    "ply_file_path",
    "train_filenames",
    "val_filenames",
    "test_filenames",
    "depth_unit_scale_factor",
    "clutter",
    "clean",
    "extra",
    "ids",
    "train_ids",
    "val_ids",
    "count",
    "frame_names",
    "time_ids",
    "camera_ids",
    "time_id",
    "warp_id",
    "appearance_id",
    "camera_id",
    "orientation",
    "position",
    "focal_length",
    "pixel_aspect_ratio",
    "principal_point",
    "image_size",
    "skew",
    "radial",
    "tangential",
    "center",
    "bbox",
    "i_test",
    "poses",
    "bds",
    "camera_path",
    "camera_to_world",
    "fov",
    "render_width",
    "type",
    "draw",
    "pick",
    "save",
    "crop",
];

/// Changes the `size` bytes at the start of `data`, at most to `data.len()`; returns how many there are then. `plain` is the
/// fuzzer's own way with bytes.
pub fn mutate(data: &mut [u8], size: usize, seed: u32, plain: impl FnOnce(&mut [u8], usize, usize) -> usize) -> usize {
    let size = size.min(data.len());
    let mut random = Random(u64::from(seed) << 1 | 1);
    let start = data[..size].iter().position(|b| *b == b'{').unwrap_or(size);
    if start <= 2
        && random.below(8) > 0
        && let Ok(mut value) = serde_json::from_slice::<Value>(&data[start..size])
    {
        for _ in 0..=random.below(3) {
            change(&mut value, &mut random);
        }
        let text = value.to_string();
        if let Some(place) = data.get_mut(start..start + text.len()) {
            place.copy_from_slice(text.as_bytes());
            if start > 0 && random.below(4) == 0 {
                data[start - 1] = b'0' + random.below(32) as u8;
            }
            return start + text.len();
        }
    }
    let most = data.len();
    plain(data, size, most)
}

struct Random(u64);

impl Random {
    /// SplitMix64.
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn word(&mut self) -> String {
        WORDS[self.below(WORDS.len())].into()
    }
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(items) => items.iter().map(count).sum(),
        Value::Object(map) => map.values().map(count).sum(),
        _ => 0,
    }
}

/// The `at`th value, from outside inwards.
fn find(value: &mut Value, mut at: usize) -> &mut Value {
    if at == 0 {
        return value;
    }
    at -= 1;
    let inner: Vec<&mut Value> = match value {
        Value::Array(items) => items.iter_mut().collect(),
        Value::Object(map) => map.values_mut().collect(),
        _ => Vec::new(),
    };
    for item in inner {
        let n = count(item);
        if at < n {
            return find(item, at);
        }
        at -= n;
    }
    unreachable!("`at` counts the values")
}

fn change(whole: &mut Value, random: &mut Random) {
    let n = count(whole);
    let other = find(whole, random.below(n)).clone();
    let value = find(whole, random.below(n));
    match (value, random.below(4)) {
        (value, 0) => *value = any(random, other),
        (Value::Array(items), _) => change_list(items, random, other),
        (Value::Object(map), _) => change_object(map, random, other),
        (value @ Value::Number(_), _) => {
            let x = value.as_f64().unwrap_or(0.0);
            let edge = NUMBERS[random.below(NUMBERS.len())];
            let near = [x + 1.0, x - 1.0, -x, x * 10.0, x * 1e-3, x + 0.1, x * edge, edge, edge, edge];
            *value = number(near[random.below(near.len())]);
        }
        (Value::String(text), 1) => text.push_str(&random.word()),
        (Value::String(text), 2) => *text = random.word(),
        (Value::String(text), _) => drop(text.pop()),
        (value, _) => *value = any(random, other),
    }
}

/// Whole numbers as such: indices are written so.
fn number(x: f64) -> Value {
    if x.fract() == 0.0 && x.abs() < 1e15 {
        return Value::Number((x as i64).into());
    }
    Number::from_f64(x).map_or(Value::Null, Value::Number)
}

fn any(random: &mut Random, other: Value) -> Value {
    match random.below(10) {
        0 => Value::Null,
        1 => Value::Bool(random.below(2) == 0),
        2..5 => number(NUMBERS[random.below(NUMBERS.len())]),
        5 => Value::String(random.word()),
        6 => Value::Array(vec![other]),
        7 => Value::Array(Vec::new()),
        _ => other,
    }
}

fn change_list(items: &mut Vec<Value>, random: &mut Random, other: Value) {
    let at = random.below(items.len());
    match random.below(5) {
        0 => items.push(other),
        1 if !items.is_empty() => drop(items.remove(at)),
        2 if !items.is_empty() => items.insert(at, items[at].clone()),
        3 if !items.is_empty() => {
            let with = random.below(items.len());
            items.swap(at, with);
        }
        _ => items.truncate(at),
    }
}

fn change_object(map: &mut Map<String, Value>, random: &mut Random, other: Value) {
    let keys: Vec<String> = map.keys().cloned().collect();
    let key = keys.get(random.below(keys.len())).cloned().unwrap_or_default();
    match random.below(4) {
        0 => drop(map.remove(&key)),
        1 => {
            // A value under another name.
            let value = map.get(&key).cloned().unwrap_or(other);
            map.insert(random.word(), value);
        }
        _ => {
            let value = any(random, other);
            map.insert(random.word(), value);
        }
    }
}
