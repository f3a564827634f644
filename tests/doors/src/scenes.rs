//! Small valid folders, one a dialect: the files that the inputs replace, and those that stay.

use crate::folder::File;
use flate2::Crc;
use image::{DynamicImage, GrayImage, ImageFormat, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use std::io::Cursor;

/// A folder: the files that inputs replace, counted from `0`, and those beside them.
pub(crate) struct Scene {
    /// Replaced by inputs.
    pub(crate) doors: Vec<File>,
    /// Never replaced.
    pub(crate) beside: Vec<File>,
}

fn there(name: &str, content: impl Into<Vec<u8>>) -> File {
    (name.into(), Some(content.into()))
}

/// A file that is there only when an input brings it.
fn absent(name: &str) -> File {
    (name.into(), None)
}

fn encoded(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.into().write_to(&mut bytes, format).expect("memory takes it");
    bytes.into_inner()
}

fn png(picture: impl Into<DynamicImage>) -> Vec<u8> {
    encoded(picture, ImageFormat::Png)
}

fn photo(width: u32, height: u32) -> Vec<u8> {
    png(RgbImage::from_fn(width, height, |x, y| Rgb([(x * 20) as u8, (y * 20) as u8, 7])))
}

fn grey(width: u32, height: u32, value: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    png(GrayImage::from_fn(width, height, |x, y| Luma([value(x, y)])))
}

fn grey16(width: u32, height: u32, value: impl Fn(u32, u32) -> u16) -> Vec<u8> {
    png(image::ImageBuffer::from_fn(width, height, |x, y| Luma([value(x, y)])))
}

/// An array as `numpy.save` writes it.
fn npy(kind: &str, shape: &str, data: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(data);
    bytes
}

fn f32s(shape: &str, data: &[f32]) -> Vec<u8> {
    npy("<f4", shape, data.iter().flat_map(|x| x.to_le_bytes()))
}

/// One array as `numpy.savez` writes it: an archive of stored members.
fn npz(name: &str, array: &[u8]) -> Vec<u8> {
    let mut crc = Crc::new();
    crc.update(array);
    let (sum, size) = (crc.sum().to_le_bytes(), (array.len() as u32).to_le_bytes());
    let length = (name.len() as u16).to_le_bytes();
    let about = [&[0_u8; 8][..], &sum, &size, &size, &length].concat();
    let mut bytes = [&b"PK\x03\x04\x14\0"[..], &about, &[0; 2], name.as_bytes(), array].concat();
    let start = (bytes.len() as u32).to_le_bytes();
    let entry = [&b"PK\x01\x02\x14\0\x14\0"[..], &about, &[0; 16], name.as_bytes()].concat();
    bytes.extend(&entry);
    bytes.extend(
        [&b"PK\x05\x06\0\0\0\0\x01\0\x01\0"[..], &(entry.len() as u32).to_le_bytes(), &start, &[0; 2]].concat(),
    );
    bytes
}

fn poses_bounds(n: usize, row: impl Fn(usize) -> [f64; 17]) -> Vec<u8> {
    npy("<f8", &format!("{n}, 17"), (0..n).flat_map(row).flat_map(f64::to_le_bytes))
}

/// A frame of a `transforms.json`: its image, and what else is in it.
fn frame(i: usize, file: &str, more: &str) -> String {
    format!(
        "{{\"file_path\":\"{file}\",\"transform_matrix\":[[1.0,0.0,0.0,{i}.5],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0],\
         [0.0,0.0,0.0,1.0]]{more}}}"
    )
}

fn list(items: impl IntoIterator<Item = String>) -> String {
    format!("[{}]", items.into_iter().collect::<Vec<_>>().join(","))
}

/// NeRF's and D-NeRF's form, with a variant of cluttered photos.
pub(crate) fn blender() -> Scene {
    let split = |name: &str, more: &str| {
        let frames = list((0..2).map(|i| frame(i, &format!("./{name}/r_{i}"), &more.replace('T', &format!("0.{i}")))));
        there(&format!("transforms_{name}.json"), format!("{{\"camera_angle_x\":0.7,\"frames\":{frames}}}"))
    };
    let picture =
        png(RgbaImage::from_fn(6, 6, |x, y| Rgba([x as u8 * 40, y as u8 * 40, 9, if x > 1 { 255 } else { 0 }])));
    let mut beside = Vec::new();
    for name in ["train", "val", "test"] {
        beside.extend((0..2).map(|i| there(&format!("{name}/r_{i}.png"), picture.clone())));
    }
    beside.push(there("masks/a.png", grey(6, 6, |x, _| if x < 3 { 255 } else { 0 })));
    let doors = vec![
        split("train", ",\"time\":T,\"rotation\":0.0"),
        split("val", ",\"time\":T"),
        split("test", ",\"time\":T"),
        absent("transforms_train_clutter.json"),
        absent("transforms_train_clean.json"),
        absent("holdout.txt"),
    ];
    Scene { doors, beside }
}

/// D-NeRF's form with frame numbers as times, exposures, near and far.
pub(crate) fn hdr_hexplane() -> Scene {
    let split = |name: &str| {
        let more = |i: usize| format!(",\"time\":{},\"exposures\":{i}.25", 3 + i);
        let frames = list((0..2).map(|i| frame(i, &format!("./{name}/r_{i}.png"), &more(i))));
        let text = format!("{{\"camera_angle_x\":0.7,\"near\":2.0,\"far\":6.0,\"w\":6,\"h\":6,\"frames\":{frames}}}");
        there(&format!("transforms_{name}.json"), text)
    };
    let beside = ["train", "val", "test"].into_iter().flat_map(|name| [0, 1].map(|i| format!("{name}/r_{i}.png")));
    Scene {
        beside: beside.map(|name| there(&name, photo(6, 6))).collect(),
        doors: vec![split("train"), split("val"), split("test")],
    }
}

/// instant-ngp's form, with NeRF On-the-go's list of splits.
pub(crate) fn instant_ngp() -> Scene {
    let frames = list((0..3).map(|i| frame(i, &format!("./images/{i}.png"), ",\"sharpness\":42.5")));
    let text = format!(
        "{{\"fl_x\":10.0,\"fl_y\":11.0,\"cx\":4.0,\"cy\":3.0,\"w\":8,\"h\":6,\"k1\":0.01,\"k2\":0.002,\"p1\":0.001,\"p2\":0.0,\
         \"aabb_scale\":4,\"scale\":0.5,\"offset\":[0.5,0.5,0.5],\"frames\":{frames}}}"
    );
    Scene {
        doors: vec![there("transforms.json", text), absent("split.json"), absent("holdout.txt")],
        beside: (0..3).map(|i| there(&format!("images/{i}.png"), photo(8, 6))).collect(),
    }
}

/// nerfstudio's form: named splits, masks, depth maps, start points.
pub(crate) fn nerfstudio() -> Scene {
    let more = |i: usize| {
        format!(
            ",\"mask_path\":\"masks/{i}.png\",\"depth_file_path\":\"depth/{i}.png\",\"time\":0.{i},\"transient_mask_path\":\
             \"masks/{i}.png\",\"moving_path\":\"masks/{i}.png\",\"flow_path\":\"flow/{i}.npy\",\"flow_valid_path\":\
             \"masks/{i}.png\",\"flow_to\":\"images/0.png\""
        )
    };
    let frames = list((0..3).map(|i| frame(i, &format!("images/{i}.png"), &more(i))));
    let text = format!(
        "{{\"camera_model\":\"OPENCV\",\"fl_x\":10.0,\"fl_y\":11.0,\"cx\":4.0,\"cy\":3.0,\"w\":8,\"h\":6,\"k1\":0.01,\
         \"applied_transform\":[[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0]],\"applied_scale\":0.5,\
         \"depth_unit_scale_factor\":0.001,\"ply_file_path\":\"points.ply\",\"train_filenames\":[\"images/0.png\",\
         \"images/1.png\"],\"test_filenames\":[\"images/2.png\"],\"frames\":{frames}}}"
    );
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
               property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2.5 -3 1 2 255\n0.5 0.1 4 9 8 7\n";
    let mut beside = Vec::new();
    for i in 0..3 {
        beside.push(there(&format!("images/{i}.png"), photo(8, 6)));
        beside.push(there(&format!("masks/{i}.png"), grey(8, 6, |x, _| if x < 4 { 255 } else { 0 })));
        beside.push(there(&format!("depth/{i}.png"), grey16(8, 6, |x, y| if y == 0 { 0 } else { 1500 + x as u16 })));
        beside.push(there(&format!("flow/{i}.npy"), f32s("6, 8, 2", &[1.25; 96])));
    }
    Scene { doors: vec![there("transforms.json", text), there("points.ply", ply)], beside }
}

fn colmap_beside() -> Vec<File> {
    ["a.png", "b.png", "c.png"].map(|name| there(&format!("images/{name}"), photo(8, 6))).into()
}

/// COLMAP's binary files, with Phototourism's table.
pub(crate) fn colmap_binary() -> Scene {
    let mut cameras = 1_u64.to_le_bytes().to_vec();
    cameras.extend([7_u32.to_le_bytes(), 2_u32.to_le_bytes()].concat());
    cameras.extend([8_u64.to_le_bytes(), 6_u64.to_le_bytes()].concat());
    cameras.extend([10.0_f64, 4.0, 3.0, 0.01].into_iter().flat_map(f64::to_le_bytes));
    let mut images = 3_u64.to_le_bytes().to_vec();
    for (i, name) in ["a.png", "b.png", "c.png"].into_iter().enumerate() {
        images.extend((i as u32 + 1).to_le_bytes());
        images.extend([1.0_f64, 0.0, 0.0, 0.0, -(i as f64), 0.0, 0.0].into_iter().flat_map(f64::to_le_bytes));
        images.extend(7_u32.to_le_bytes());
        images.extend(name.as_bytes());
        images.push(0);
        images.extend(11_u64.to_le_bytes());
        for point in 0..11_u64 {
            images.extend([1.0_f64, 2.0].into_iter().flat_map(f64::to_le_bytes));
            images.extend(if point == 10 { u64::MAX } else { point }.to_le_bytes());
        }
    }
    let mut points = 10_u64.to_le_bytes().to_vec();
    for point in 0..10_u64 {
        points.extend(point.to_le_bytes());
        points.extend([0.1 * point as f64, 0.0, 2.0 + point as f64].into_iter().flat_map(f64::to_le_bytes));
        points.extend([1, 2, 3]);
        points.extend(0.5_f64.to_le_bytes());
        points.extend(1_u64.to_le_bytes());
        points.extend([0; 8]);
    }
    Scene {
        doors: vec![
            there("sparse/0/cameras.bin", cameras),
            there("sparse/0/images.bin", images),
            there("sparse/0/points3D.bin", points),
            absent("scene.tsv"),
            absent("split.json"),
            absent("holdout.txt"),
        ],
        beside: colmap_beside(),
    }
}

/// COLMAP's text files: three lenses.
pub(crate) fn colmap_text() -> Scene {
    let cameras = "# cameras\n1 OPENCV 8 6 10 10 4 3 0.1 0 0 0\n2 FOV 8 6 10 10 4 3 0.5\n3 THIN_PRISM_FISHEYE 8 6 9 9 4 3 \
                   .1 0 0 0 0 0 0 0\n";
    let images =
        "1 1 0 0 0 0 0 0 1 a.png\n1 2 -1 3 4 9\n2 0.9 0.1 0 0 1 0 0 2 b.png\n\n3 0.9 0 0.1 0 2 0 0 3 c.png\n3 4 10\n";
    let points = "9 0 0 3 1 2 3 0.1 5 1\n10 1 0 3 1 2 3 0.1 5 1\n";
    Scene {
        doors: vec![
            there("sparse/0/cameras.txt", cameras),
            there("sparse/0/images.txt", images),
            there("sparse/0/points3D.txt", points),
            absent("scene.tsv"),
        ],
        beside: colmap_beside(),
    }
}

/// LLFF: poses of three photos, points of a model beside them.
pub(crate) fn llff() -> Scene {
    // Columns down, right, backwards; centre; height, width and focal length; near and far.
    let row = |i: usize| [0., 1., 0., i as f64, 12., -1., 0., 0., 0., 16., 0., 0., 1., 0., 20., 1., 5.];
    Scene {
        doors: vec![
            there("poses_bounds.npy", poses_bounds(3, row)),
            there("sparse/0/points3D.txt", "9 0 0 3 1 2 3 0.1 5 1\n"),
            absent("holdout.txt"),
        ],
        beside: (0..3).map(|i| there(&format!("images/{i}.png"), photo(16, 12))).collect(),
    }
}

/// An endoscope: poses, tools, depth, true tools.
pub(crate) fn endonerf() -> Scene {
    let row = |_| [1., 0., 0., 0., 12., 0., 1., 0., 0., 16., 0., 0., 1., 0., 20., 0., 90.];
    let tool = |wide: u32| grey(16, 12, move |x, _| if x < wide { 255 } else { 0 });
    let depth = || grey(16, 12, |x, y| if y == 0 { 0 } else { 50 + x as u8 });
    let beside = (0..3).map(|i| there(&format!("images/{i}.png"), photo(16, 12)));
    let more = (1..3).flat_map(|i| {
        [
            there(&format!("masks/{i}.png"), tool(2)),
            there(&format!("gt_masks/{i}.png"), tool(1)),
            there(&format!("depth/{i}.png"), depth()),
        ]
    });
    Scene {
        doors: vec![
            there("poses_bounds.npy", poses_bounds(3, row)),
            there("masks/0.png", tool(2)),
            there("depth/0.png", depth()),
            there("gt_masks/0.png", tool(1)),
        ],
        beside: beside.chain(more).collect(),
    }
}

/// NR-NeRF: images in time order, the third held out.
pub(crate) fn nr_nerf() -> Scene {
    let poses = list((0..3).map(|i| format!("[[1,0,0,{i}.5,12.0],[0,1,0,0,16.0],[0,0,1,0,20.5]]")));
    let bounds = list((0..3).map(|i| format!("[0.{},{}.0]", i + 1, i + 2)));
    let text = format!("{{\"poses\":{poses},\"bds\":{bounds},\"render_poses\":[],\"i_test\":[2]}}");
    Scene {
        doors: vec![there("precomputed.json", text), absent("holdout.txt")],
        beside: (0..3).map(|i| there(&format!("images/{i}.png"), photo(16, 12))).collect(),
    }
}

/// DyCheck's form: camera 0 trains on moments 0 and 2, camera 1 is tested at 1.
pub(crate) fn nerfies() -> Scene {
    let ids = [("0_0", 0, 0), ("0_2", 2, 0), ("1_1", 1, 1)];
    let camera = |i: usize| {
        format!(
            "{{\"orientation\":[[1,0,0],[0,-1,0],[0,0,-1]],\"position\":[{i}.5,0,0],\"focal_length\":20.0,\
             \"pixel_aspect_ratio\":1.1,\"principal_point\":[8.2,5.9],\"skew\":0.0,\"image_size\":[16,12],\
             \"radial_distortion\":[0.01,0.002,0.0],\"tangential_distortion\":[0.001,-0.001]}}"
        )
    };
    let metadata: Vec<String> = ids
        .iter()
        .map(|(id, time, camera)| {
            format!("\"{id}\":{{\"appearance_id\":{time},\"camera_id\":{camera},\"warp_id\":{time}}}")
        })
        .collect();
    let dataset =
        r#"{"count":3,"num_exemplars":2,"ids":["0_0","0_2","1_1"],"train_ids":["0_0","0_2"],"val_ids":["1_1"]}"#;
    let depth: Vec<f32> = (0..48).map(|k| if k % 8 < 4 { 1.5 + 0.01 * k as f32 } else { 0.0 }).collect();
    let picture =
        png(RgbaImage::from_fn(8, 6, |x, y| Rgba([x as u8 * 20, y as u8 * 20, 7, if x < 4 { 255 } else { 0 }])));
    let mut beside: Vec<File> = ids.iter().map(|id| there(&format!("rgb/2x/{}.png", id.0), picture.clone())).collect();
    beside.extend([1, 2].map(|i| there(&format!("camera/{}.json", ids[i].0), camera(i))));
    beside.push(there("depth/2x/0_2.npy", f32s("6, 8, 1", &depth)));
    beside.push(there("covisible/2x/val/1_1.png", grey(8, 6, |x, _| u8::from(x < 2))));
    let doors = vec![
        there("dataset.json", dataset),
        there("metadata.json", format!("{{{}}}", metadata.join(","))),
        there("camera/0_0.json", camera(0)),
        there("scene.json", r#"{"center":[1.0,2.0,3.0],"scale":0.5,"near":0.1,"far":2.0}"#),
        there("extra.json", r#"{"bbox":[[-0.5,-0.25,-1.0],[0.5,0.25,1.0]],"factor":2,"fps":30.0}"#),
        there("splits/train.json", r#"{"frame_names":["0_0","0_2"],"time_ids":[0,2],"camera_ids":[0,0]}"#),
        there("splits/val.json", r#"{"frame_names":["1_1"],"time_ids":[1],"camera_ids":[1]}"#),
        there("points.npy", f32s("2, 3", &[1.0, 2.0, 3.0, f32::NAN, 0.0, 0.0])),
        there("depth/2x/0_0.npy", f32s("6, 8, 1", &depth)),
    ];
    Scene { doors, beside }
}

/// Depth maps and masks of one frame, in every format.
pub(crate) fn maps() -> Scene {
    let exr = encoded(image::Rgb32FImage::from_pixel(8, 6, Rgb([0.1, 0.2, 0.3])), ImageFormat::OpenExr);
    let maps = ["depth/0.npy", "depth/1.png", "depth/2.exr", "masks/3.png"];
    let key = |i: usize| if i < 3 { "depth_file_path" } else { "mask_path" };
    let frames = list(maps.iter().enumerate().map(|(i, map)| {
        frame(i, &format!("images/{i}.png"), &format!(",\"{}\":\"{map}\",\"moving_path\":\"moving.png\"", key(i)))
    }));
    let text = format!("{{\"camera_model\":\"PINHOLE\",\"fl_x\":10.0,\"w\":8,\"h\":6,\"frames\":{frames}}}");
    let mask = || grey(8, 6, |x, _| if x < 4 { 255 } else { 0 });
    let mut beside: Vec<File> = (0..4).map(|i| there(&format!("images/{i}.png"), photo(8, 6))).collect();
    beside.push(there("transforms.json", text));
    let doors = vec![
        there(maps[0], f32s("6, 8", &[2.0; 48])),
        there(maps[1], grey16(8, 6, |x, _| 1500 + x as u16)),
        there(maps[2], exr),
        there(maps[3], mask()),
        there("moving.png", mask()),
    ];
    Scene { doors, beside }
}

/// What other programs made of a photo: segments, features, flow, disparity, what moves.
pub(crate) fn priors() -> Scene {
    let more = ",\"flow_path\":\"flow.npy\",\"flow_valid_path\":\"valid.png\",\"flow_to\":\"images/1.png\"";
    let frames = list([frame(0, "images/0.png", more), frame(1, "images/1.png", "")]);
    let text = format!("{{\"camera_model\":\"PINHOLE\",\"fl_x\":10.0,\"w\":8,\"h\":6,\"frames\":{frames}}}");
    let mask = || grey(8, 6, |x, _| if x < 4 { 255 } else { 0 });
    let doors = vec![
        there("images/0.segs.png", grey16(8, 6, |x, _| 300 * x as u16)),
        there("images/1.segs/a.png", mask()),
        there("images/0.points/a.png", mask()),
        there("images/0.points/scores.txt", "0.91 0.95\n"),
        there("images/0.features.npy", npy("<f2", "2, 1, 2", [0, 60, 0, 0, 0, 60, 0, 192])),
        there("flow.npy", f32s("6, 8, 2", &[1.25; 96])),
        there("valid.png", mask()),
        there("flow/0_fwd.flo", [&b"PIEH\x08\0\0\0\x06\0\0\0"[..], &[0_u8, 0, 160, 63].repeat(96)].concat()),
        there("flow/1_bwd.npz", npz("flow.npy", &f32s("6, 8, 2", &[-1.25; 96]))),
        there("disp/0.npy", f32s("6, 8", &[0.5; 48])),
        there("motion_masks/0.png", mask()),
    ];
    let beside =
        vec![there("transforms.json", text), there("images/0.png", photo(8, 6)), there("images/1.png", photo(8, 6))];
    Scene { doors, beside }
}
