//! The PLY of 3DGS.

use super::*;

/// Names of the properties of 3DGS with `per_channel` coefficients above degree 0, in its order.
fn names(per_channel: usize) -> Vec<String> {
    let head = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned);
    let tail = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned);
    head.into_iter().chain((0..3 * per_channel).map(|i| format!("f_rest_{i}"))).chain(tail).collect()
}

/// What the property of that name holds in a cloud.
fn value(cloud: &Gaussians, name: &str, i: usize) -> f32 {
    let n = cloud.len();
    let per_channel = rest_len(cloud.degree());
    let (stem, number) = name.rsplit_once('_').map_or((name, 0), |(s, k)| (s, k.parse().unwrap_or(0)));
    match stem {
        "x" | "y" | "z" => cloud.mean[(stem.as_bytes()[0] - b'x') as usize * n + i],
        "f_dc" => cloud.dc[number * n + i],
        // Channel after channel in the file; coefficient after coefficient, channels inside, in memory.
        "f_rest" if per_channel > 0 => cloud.rest[(3 * (number % per_channel) + number / per_channel) * n + i],
        "opacity" => cloud.logit[i],
        "scale" => cloud.log_scale[number * n + i],
        "rot" => cloud.wxyz[number * n + i],
        _ => 0.0,
    }
}

#[derive(Clone, Copy, Debug)]
enum Form {
    Ascii,
    Little,
    Big,
}

/// A file with these properties, `double` where the flag says so.
fn build(cloud: &Gaussians, form: Form, properties: &[(String, bool)]) -> Vec<u8> {
    let format = match form {
        Form::Ascii => "ascii",
        Form::Little => "binary_little_endian",
        Form::Big => "binary_big_endian",
    };
    let mut bytes = format!("ply\nformat {format} 1.0\ncomment by hand\nelement vertex {}\n", cloud.len()).into_bytes();
    for (name, double) in properties {
        bytes.extend(format!("property {} {name}\n", if *double { "double" } else { "float" }).bytes());
    }
    bytes.extend(b"end_header\n");
    for i in 0..cloud.len() {
        for (name, double) in properties {
            let x = value(cloud, name, i);
            match (form, double) {
                (Form::Ascii, _) => bytes.extend(format!("{x} ").bytes()),
                (Form::Little, false) => bytes.extend(x.to_le_bytes()),
                (Form::Little, true) => bytes.extend(f64::from(x).to_le_bytes()),
                (Form::Big, false) => bytes.extend(x.to_be_bytes()),
                (Form::Big, true) => bytes.extend(f64::from(x).to_be_bytes()),
            }
        }
        if matches!(form, Form::Ascii) {
            bytes.push(b'\n');
        }
    }
    bytes
}

fn plain(cloud: &Gaussians) -> Vec<u8> {
    let properties: Vec<_> = names(rest_len(cloud.degree())).into_iter().map(|name| (name, false)).collect();
    build(cloud, Form::Little, &properties)
}

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    #[test]
    fn files_are_those_built_by_hand(cloud in any_cloud(0..=MAX_DEGREE, 5)) {
        let (bytes, notes) = encode("a.ply", &cloud);
        prop_assert!(notes.is_empty());
        let by_hand = replaced(&plain(&cloud), "comment by hand\n", "");
        prop_assert!(bytes == by_hand);
    }

    #[test]
    fn any_finite_numbers_come_back_bit_for_bit(
        words in prop::collection::vec(any::<f32>().prop_filter("finite", |x| x.is_finite()), 23 * 3),
    ) {
        let mut cloud = Gaussians::new(3, 1).unwrap();
        let mut words = words.into_iter();
        for (_, field) in cloud.fields_mut() {
            field.iter_mut().for_each(|x| *x = words.next().unwrap());
        }
        let file = parse("a.ply", &encode("a.ply", &cloud).0).unwrap();
        prop_assert_eq!(bits(&file.cloud), bits(&cloud));
        prop_assert!(file.notes.is_empty());
    }

    #[test]
    fn order_type_and_company_of_properties_do_not_matter(
        cloud in any_cloud(0..=MAX_DEGREE, 3),
        keys in prop::collection::vec(any::<u32>(), 64),
        doubles: u64,
        form in prop_oneof![Just(Form::Ascii), Just(Form::Little), Just(Form::Big)],
        normals: bool,
    ) {
        let mut all = names(rest_len(cloud.degree()));
        all.retain(|name| normals || !name.starts_with('n'));
        all.extend(["f_intr_0".to_owned(), "segment".to_owned()]);
        let mut properties: Vec<_> =
            all.into_iter().enumerate().map(|(i, name)| (name, doubles >> i & 1 == 1)).collect();
        properties.sort_by_cached_key(|(name, _)| {
            keys[name.bytes().fold(0, |hash, b| (31 * hash + usize::from(b)) % keys.len())]
        });
        let file = parse("a.ply", &build(&cloud, form, &properties)).unwrap();
        prop_assert_eq!(bits(&file.cloud), bits(&cloud));
        prop_assert_eq!(file.notes.len(), 1);
        prop_assert!(file.notes[0].contains("ignored 2 properties") && file.notes[0].contains("`segment`"));
    }
}

#[test]
fn every_cut_is_an_error() {
    let cloud = trained::small();
    let bytes = encode("a.ply", &cloud).0;
    for length in 0..bytes.len() {
        assert!(parse("a.ply", &bytes[..length]).is_err(), "cut to {length} of {}", bytes.len());
    }
}

#[test]
fn harmonics_of_other_numbers_are_refused_or_cut_with_a_note() {
    let cloud = Gaussians::new(2, 0).unwrap();
    let with = |n: usize| {
        let mut all = names(0);
        all.extend((0..n).map(|i| format!("f_rest_{i}")));
        let properties: Vec<_> = all.into_iter().map(|name| (name, false)).collect();
        let mut bytes = build(&cloud, Form::Little, &properties);
        // The coefficients of the first Gaussian tell where they come from.
        let body = bytes.len() - 2 * 4 * properties.len();
        for i in 0..n {
            bytes[body + 4 * (17 + i)..][..4].copy_from_slice(&(i as f32).to_le_bytes());
        }
        bytes
    };
    for n in [1, 3, 8, 27, 44, 48, 73] {
        refused(parse("a.ply", &with(n)), &[&format!("{n} properties `f_rest_*`")]);
    }
    // Degree 4: 24 coefficients a channel, 15 of them kept.
    let file = parse("a.ply", &with(72)).unwrap();
    assert_eq!(file.cloud.degree(), 3);
    has_note(&file.notes, "above degree 3 left out");
    let first: Vec<f32> = file.cloud.rest.chunks_exact(2).map(|row| row[0]).collect();
    let want: Vec<f32> = (0..15).flat_map(|k| [0, 1, 2].map(|channel| (24 * channel + k) as f32)).collect();
    assert_eq!(first, want);
    refused(parse("a.ply", &replaced(&with(9), "f_rest_7", "f_rest_9")), &["lack `f_rest_7`"]);
}

#[test]
fn missing_and_double_properties_are_named() {
    let bytes = plain(&Gaussians::new(1, 0).unwrap());
    for name in names(0).iter().filter(|name| !name.starts_with('n')) {
        let line = format!("property float {name}\n");
        refused(parse("a.ply", &replaced(&bytes, &line, "property float other\n")), &[&format!("lack `{name}`")]);
        let twice = replaced(&bytes, "property float nx\n", &line);
        refused(parse("a.ply", &twice), &[&format!("two properties `{name}`")]);
    }
}

#[test]
fn what_is_not_finite_is_dropped() {
    let mut cloud = trained::small();
    let n = cloud.len();
    cloud.mean[n + 1] = f32::NAN;
    cloud.rest[2 * n + 3] = f32::INFINITY;
    cloud.logit[0] = f32::INFINITY;
    let file = parse("a.ply", &plain(&cloud)).unwrap();
    assert_eq!(file.cloud.len(), n - 2);
    has_note(&file.notes, &format!("2 Gaussians that are not finite dropped of {n}, first number 1"));
    has_note(&file.notes, "1 opacity of exactly 0 or 1");
    assert_eq!(file.cloud.mean[1], cloud.mean[2]);
    assert!((13.8..13.9).contains(&file.cloud.logit[0]));
    // A `double` beyond the range of `float` is not finite either.
    let x = replaced(&plain(&Gaussians::new(1, 0).unwrap()), "float x", "double x");
    let body = x.len() - 4 * 17;
    let large = [&x[..body], &1e300_f64.to_le_bytes(), &x[body + 4..]].concat();
    assert!(parse("a.ply", &large).unwrap().cloud.is_empty());
}

#[test]
fn forged_counts_do_not_allocate() {
    let bytes = plain(&Gaussians::new(1, 3).unwrap());
    let ascii: Vec<_> = names(15).into_iter().map(|name| (name, false)).collect();
    let ascii = build(&Gaussians::new(1, 3).unwrap(), Form::Ascii, &ascii);
    for count in ["2", "1000000000000", "18446744073709551615"] {
        for bytes in [&bytes, &ascii] {
            refused(parse("a.ply", &replaced(bytes, "vertex 1", &format!("vertex {count}"))), &["is cut off", count]);
        }
    }
    refused(parse("a.ply", &replaced(&bytes, "vertex 1", "vertex -1")), &["a.ply:4", "not a number"]);
}
