//! Small files that ask for much memory: they are answered with one line, or read within the limit.

#[path = "counting/mod.rs"]
mod counting;

use counting::{alone, peak_of};
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use scene_io::{
    DecodeMemory, Depth, ErrorKind, ImageStore, LoadOptions, PerturbationKind, StoreOptions, check, decode_photo, load,
    read_splats,
};
use std::fs;
use std::io::Write;
use std::path::Path;

const MB: u64 = 1_000_000;

/// A JPEG of one colour: tables of one code, and no more than the first bits of the picture.
fn jpeg(progressive: bool, width: u16, height: u16) -> Vec<u8> {
    let segment = |marker: u8, body: &[u8]| {
        let length = u16::try_from(body.len() + 2).unwrap().to_be_bytes();
        [&[0xff, marker], length.as_slice(), body].concat()
    };
    let [h, w] = [height, width].map(u16::to_be_bytes);
    let frame = [8, h[0], h[1], w[0], w[1], 3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0];
    // One code of one bit: the value 0.
    let table = |class: u8| [&[class, 1][..], &[0; 15], &[0]].concat();
    let scan = |end: u8| [3, 1, 0, 2, 0, 3, 0, 0, end, 0];
    [
        vec![0xff, 0xd8],
        segment(0xdb, &[&[0][..], &[1; 64]].concat()),
        segment(if progressive { 0xc2 } else { 0xc0 }, &frame),
        segment(0xc4, &table(0x00)),
        segment(0xc4, &table(0x10)),
        segment(0xda, &scan(if progressive { 0 } else { 63 })),
        vec![0; 8],
        vec![0xff, 0xd9],
    ]
    .concat()
}

/// A grey PNG with one more chunk, of zeros that unpack to `bytes`.
fn png(kind: &[u8; 4], before: &[u8], bytes: usize) -> Vec<u8> {
    let zeros = |n: usize, level| {
        let mut zlib = ZlibEncoder::new(Vec::new(), level);
        let some = vec![0; 1 << 20];
        for at in (0..n).step_by(some.len()) {
            zlib.write_all(&some[..some.len().min(n - at)]).unwrap();
        }
        zlib.finish().unwrap()
    };
    let chunk = |kind: &[u8; 4], body: &[u8]| {
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(body);
        let length = u32::try_from(body.len()).unwrap().to_be_bytes();
        [length.as_slice(), kind, body, &crc.sum().to_be_bytes()].concat()
    };
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(b"IHDR", &[0, 0, 0, 8, 0, 0, 0, 6, 8, 0, 0, 0, 0]),
        chunk(kind, &[before, &zeros(bytes, Compression::best())].concat()),
        chunk(b"IDAT", &zeros(6 * 9, Compression::fast())),
        chunk(b"IEND", &[]),
    ]
    .concat()
}

/// An SPZ of zeros: `count` Gaussians listed, `there` of them in the file.
fn spz(count: u32, there: usize, degree: u8) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(b"NGSP\x03\0\0\0").unwrap();
    gzip.write_all(&count.to_le_bytes()).unwrap();
    gzip.write_all(&[degree, 12, 0, 0]).unwrap();
    let rest = [0, 9, 24, 45, 72][usize::from(degree)];
    let some = vec![0; (20 + rest) << 10];
    for at in (0..there).step_by(1 << 10) {
        gzip.write_all(&some[..(20 + rest) * (there - at).min(1 << 10)]).unwrap();
    }
    gzip.finish().unwrap()
}

/// A dataset of these photos, all of one size.
fn dataset(photos: &[Vec<u8>], (width, height): (u32, u32)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<String> = photos
        .iter()
        .enumerate()
        .map(|(i, photo)| {
            fs::write(folder.path().join(format!("{i}.jpg")), photo).unwrap();
            format!(
                r#"{{"file_path": "{i}.jpg", "transform_matrix": [[1, 0, 0, {i}], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}}"#
            )
        })
        .collect();
    let text = format!(
        r#"{{"fl_x": {width}, "fl_y": {width}, "w": {width}, "h": {height}, "frames": [{}]}}"#,
        frames.join(", ")
    );
    fs::write(folder.path().join("transforms.json"), text).unwrap();
    folder
}

fn within<T>(limit: u64, work: impl FnOnce() -> T) -> (T, u64) {
    peak_of(|| {
        DecodeMemory::of_process().set_limit(limit);
        let result = work();
        assert_eq!(DecodeMemory::of_process().used(), 0);
        result
    })
}

fn one_line(text: &str, words: &[&str]) {
    assert!(!text.contains('\n') && words.iter().all(|word| text.contains(word)), "{text}");
}

#[test]
fn a_progressive_jpeg_counts_its_coefficients() {
    let _alone = alone();
    let bytes = jpeg(true, 26_000, 26_000);
    assert!(bytes.len() < 250, "{}", bytes.len());
    let folder = dataset(&[bytes.clone(), bytes], (26_000, 26_000));
    let (report, peak) = within(4 << 30, || check(folder.path(), &LoadOptions::default(), Depth::Pixels));
    assert_eq!(report.problems.len(), 2, "{report}");
    for (problem, name) in report.problems.iter().zip(["0.jpg", "1.jpg"]) {
        one_line(&problem.to_string(), &[name, "26000x26000 pixels takes 6.09 GB", "`--memory 11608`"]);
    }
    assert!(peak < 10 * MB, "{peak}");
}

#[test]
fn a_photo_that_cannot_be_decoded_is_refused_before_anything_is_made_of_its_size() {
    let _alone = alone();
    let folder = dataset(&vec![jpeg(false, 65_500, 65_500); 8], (65_500, 65_500));
    let (error, peak) = within(1 << 30, || {
        let scene = load(folder.path(), &LoadOptions::default()).unwrap();
        let scene = scene_io::perturb(scene, PerturbationKind::Both, 0);
        ImageStore::new(&scene.frames, StoreOptions::default()).unwrap().check_sizes().unwrap_err().to_string()
    });
    one_line(&error, &["0.jpg", "65500x65500 pixels takes", "`--memory"]);
    assert!(peak < 10 * MB, "{peak}");
}

/// One reader sees a small picture behind these bytes, another one the progressive picture in them.
#[test]
fn a_jpeg_that_shows_two_pictures_is_not_believed() {
    let _alone = alone();
    let progressive = jpeg(true, 26_000, 26_000);
    // A picture that all agree on, far enough behind for a length of 0xffc2.
    let plain = [vec![0xff, 0xfe, 0, 2], jpeg(false, 26_000, 26_000)[2..].to_vec()].concat();
    let at = progressive.windows(2).position(|pair| pair == [0xff, 0xc2]).unwrap();
    // The last one leads its reader to other bytes, which are not JPEG.
    let fills: [(&[u8], &str); 4] = [
        (&[0xff, 0x00], "of memory"),
        (&[0xff, 0x01, 0, 2], "of memory"),
        (&[0xff, 0xd0, 0, 2], "of memory"),
        (b"\xff\xe0\0\x06JFIF", "is broken"),
    ];
    for (fill, said) in fills {
        let two = [&progressive[..at], fill, &progressive[at..], &vec![0; 0xffc2], &plain].concat();
        let folder = dataset(&[two], (26_000, 26_000));
        let (result, peak) = within(2 << 30, || decode_photo(&folder.path().join("0.jpg")));
        one_line(&result.unwrap_err().to_string(), &["0.jpg", said]);
        assert!(peak < 20 * MB, "{peak}");
    }
}

#[test]
fn a_progressive_jpeg_that_fits_is_decoded_one_at_a_time() {
    let _alone = alone();
    let folder = dataset(&[jpeg(true, 2000, 2000), jpeg(true, 2000, 2000), jpeg(true, 2000, 2000)], (2000, 2000));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let run = || pool.install(|| check(folder.path(), &LoadOptions::default(), Depth::Pixels));
    // 24 MB of coefficients, 12 of pixels.
    let (report, peak) = within(50 * MB, run);
    assert!(report.can_train() && peak < 50 * MB && peak > 35 * MB, "{peak}: {report}");
    let (other, peak) = within(250 * MB, run);
    assert!(peak < 250 * MB, "{peak}");
    assert_eq!(report.to_string(), other.to_string());
}

#[test]
fn small_pictures_of_large_photos_take_turns() {
    let _alone = alone();
    let photos = vec![jpeg(false, 2400, 2400); 4];
    let folder = dataset(&photos, (2400, 2400));
    let scene = load(folder.path(), &LoadOptions::default()).unwrap();
    let options = StoreOptions::default().with_longest_side(16);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let (images, peak) = within(25 * MB, || {
        use rayon::prelude::*;
        let store = ImageStore::new(&scene.frames, options).unwrap();
        pool.install(|| (0..4).into_par_iter().map(|i| store.get(i)).collect::<Result<Vec<_>, _>>())
    });
    let images = images.unwrap();
    // One has 17 MB of pixels.
    assert!(images.iter().all(|i| (i.width, i.height) == (16, 16)) && peak < 25 * MB, "{peak}");
}

#[test]
fn profiles_and_texts_of_a_png_are_not_inflated() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    for (kind, before) in
        [(b"iCCP", &b"name\0\0"[..]), (b"zTXt", b"name\0\0"), (b"iTXt", b"XML:com.adobe.xmp\0\x01\0\0\0")]
    {
        fs::write(&path, png(kind, before, 150_000_000)).unwrap();
        let (picture, peak) = within(20 * MB, || decode_photo(&path));
        assert_eq!(picture.unwrap().width(), 8);
        assert!(peak < 2 * MB, "{kind:?}: {peak}");
        // Where the error names the file's EXIF rotation, the headers are read again.
        let (scene, peak) = within(20 * MB, || scene_io::photo_size(&path));
        assert!(scene.unwrap() == (8, 6).into() && peak < 2 * MB, "{peak}");
    }
    // Chunks that are kept end somewhere.
    let mut long = png(b"iCCP", b"name\0\0", 100);
    let at = long.windows(4).position(|w| w == b"iCCP").unwrap() - 4;
    let mut exif = vec![0; 40_000_000];
    exif[..4].copy_from_slice(&39_999_988_u32.to_be_bytes());
    exif[4..8].copy_from_slice(b"eXIf");
    long.splice(at..at, exif);
    fs::write(&path, long).unwrap();
    let (error, peak) = within(100 * MB, || decode_photo(&path).unwrap_err());
    one_line(&error.to_string(), &["a.png"]);
    assert!(peak < 60 * MB, "{peak}");
}

#[test]
fn forged_sizes_are_refused_before_memory_is_taken() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut bytes = png(b"iCCP", b"name\0\0", 10);
    for side in [30_000_u32, 0x7fff_ffff] {
        bytes[16..20].copy_from_slice(&side.to_be_bytes());
        bytes[20..24].copy_from_slice(&side.to_be_bytes());
        let mut crc = flate2::Crc::new();
        crc.update(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.sum().to_be_bytes());
        fs::write(&path, &bytes).unwrap();
        let (error, peak) = within(500 * MB, || decode_photo(&path).unwrap_err());
        one_line(&error.to_string(), &["a.png"]);
        assert!(peak < 20 * MB, "{side}: {peak}");
    }
}

#[test]
fn gaussians_are_bounded_by_the_bytes_there_are() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.spz");
    let read = |bytes: &[u8], limit| {
        fs::write(&path, bytes).unwrap();
        within(limit, || read_splats(&path))
    };
    // Ten million listed, none there; and the other way round.
    for bytes in [spz(10_000_000, 0, 3), spz(10_000_000, 2_000_000, 3), spz(1000, 1_000_000, 3)] {
        let (result, peak) = read(&bytes, 4 << 30);
        one_line(&result.unwrap_err().to_string(), &["a.spz", "than the"]);
        assert!(peak < 2 * MB, "{peak} for {} bytes", bytes.len());
    }
    // All there: a million of degree 3 is a cloud of 236 MB.
    let bytes = spz(1_000_000, 1_000_000, 3);
    assert!(bytes.len() < 400_000, "{}", bytes.len());
    let (result, peak) = read(&bytes, 200 * MB);
    let error = result.unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Memory);
    one_line(&error.to_string(), &["a.spz", "its 1000000 Gaussians takes 236", "200.0 MB"]);
    assert!(peak < 2 * MB, "{peak}");
    let (result, peak) = read(&bytes, 240 * MB);
    assert!(result.unwrap().cloud.len() == 1_000_000 && peak < 240 * MB && peak > 236 * MB, "{peak}");
}

#[test]
fn a_file_larger_than_the_limit_is_not_read() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.splat", "a.ply", "transforms.json"] {
        let path = folder.path().join(name);
        // A hole: nothing on the disk.
        fs::File::create(&path).unwrap().set_len(32_000_000_000).unwrap();
        let error = |path: &Path| match name {
            "transforms.json" => load(path.parent().unwrap(), &LoadOptions::default()).unwrap_err(),
            _ => read_splats(path).unwrap_err(),
        };
        let (error, peak) = within(100 * MB, || error(&path));
        one_line(&error.to_string(), &[name, "32.00 GB", "100.0 MB"]);
        assert!(peak < MB, "{peak}");
    }
}
