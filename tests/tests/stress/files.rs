//! Files with numbers that are none: pixels of EXR pictures, entries of poses, focal lengths.

use scene_io::{ImageStore, LoadOptions, Scene, SceneError, StoreOptions, load};
use std::path::Path;
use stress::{Tally, Verdict, ensure};

const IDENTITY: &str = "[[1,0,0,POS],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

/// Two EXR pictures of 8x6 and their cameras, `spoil` applied to the text.
fn write(folder: &Path, pixel: Option<(u32, u32, [f32; 4])>, alpha: bool, spoil: impl Fn(String) -> String) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    for i in 0..2 {
        let file = folder.join(format!("images/{i}.exr"));
        let pixel = pixel.filter(|_| i == 1);
        if alpha {
            let mut image = image::Rgba32FImage::from_pixel(8, 6, image::Rgba([0.5, 0.25, 0.125, 1.0]));
            if let Some((x, y, p)) = pixel {
                image.put_pixel(x, y, image::Rgba(p));
            }
            image.save(file).unwrap();
        } else {
            let mut image = image::Rgb32FImage::from_pixel(8, 6, image::Rgb([0.5, 0.25, 0.125]));
            if let Some((x, y, p)) = pixel {
                image.put_pixel(x, y, image::Rgb([p[0], p[1], p[2]]));
            }
            image.save(file).unwrap();
        }
    }
    let frame = |i: u32| {
        let matrix = IDENTITY.replace("POS", &format!("{i}.5"));
        format!(r#"{{"file_path":"images/{i}.exr","transform_matrix":{matrix}}}"#)
    };
    let text = format!(
        r#"{{"fl_x":10.0,"fl_y":11.0,"cx":4.0,"cy":3.0,"w":8,"h":6,"aabb_scale":1,"frames":[{},{}]}}"#,
        frame(0),
        frame(1)
    );
    std::fs::write(folder.join("transforms.json"), spoil(text)).unwrap();
}

fn loaded(folder: &Path) -> Result<Scene, SceneError> {
    load(folder, &LoadOptions::default())
}

fn says(e: &SceneError, words: &[&str]) -> Verdict {
    let said = e.to_string();
    let missing = words.iter().find(|w| !said.contains(*w));
    ensure(missing.is_none() && !said.contains('\n'), || format!("does not say {missing:?}: {said}"))
}

pub(crate) fn cases(tally: &mut Tally) {
    for alpha in [false, true] {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for channel in 0..if alpha { 4 } else { 3 } {
                for (x, y) in [(0, 0), (5, 3), (7, 5)] {
                    let name = format!("EXR, alpha {alpha}, channel {channel} of pixel ({x}, {y}) is {bad}");
                    tally.case(name, "one error with file, channel, pixel and remedy", || {
                        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
                        let mut pixel = [0.5, 0.5, 0.5, 1.0];
                        pixel[channel] = bad;
                        write(folder.path(), Some((x, y, pixel)), alpha, |t| t);
                        let scene = loaded(folder.path()).map_err(|e| e.to_string())?;
                        let store =
                            ImageStore::new(&scene.frames, StoreOptions::default()).map_err(|e| e.to_string())?;
                        store.get(0).map_err(|e| e.to_string())?;
                        let place = format!("pixel (column {x}, row {y})");
                        match store.get(1) {
                            Err(e) => {
                                says(&e, &["1.exr", &format!("`{}`", ["R", "G", "B", "A"][channel]), &place, "mask"])
                            }
                            Ok(_) => Err("taken".into()),
                        }
                    });
                }
            }
        }
        for value in [0.0, -0.0, 1e-45, 1e-38, -1.0, 1.0, 1.000_001, 65_504.0, 3e38, -3e38, f32::MAX] {
            tally.case(format!("EXR, alpha {alpha}, a pixel of {value:e}"), "clipped to 8 bits", || {
                let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
                write(folder.path(), Some((5, 3, [value, value, value, value])), alpha, |t| t);
                let scene = loaded(folder.path()).map_err(|e| e.to_string())?;
                let store = ImageStore::new(&scene.frames, StoreOptions::default()).map_err(|e| e.to_string())?;
                let image = store.get(1).map_err(|e| e.to_string())?;
                let got = image.pixel(5, 3)[0];
                let dark = value < 1e-6;
                // With alpha the colour is divided by it: equal ones give 1.
                let want = if value <= 0.0 || (dark && !alpha) { 0 } else { 255 };
                let denormal = alpha && dark && value > 0.0;
                ensure(got == want || denormal, || format!("{got}, expected {want}"))
            });
        }
    }
    let spoilt = [
        ("fl_x 0", "\"fl_x\":10.0", "\"fl_x\":0.0", "fl_x"),
        ("fl_x negative", "\"fl_x\":10.0", "\"fl_x\":-10.0", "fl_x"),
        ("fl_y overflows", "\"fl_y\":11.0", "\"fl_y\":1e999", "transforms.json"),
        ("cx NaN", "\"cx\":4.0", "\"cx\":NaN", "transforms.json"),
        ("a shear", "[[1,0,0,1.5]", "[[1,0.1,0,1.5]", "transform_matrix"),
        ("a mirror", "[[1,0,0,1.5]", "[[-1,0,0,1.5]", "transform_matrix"),
        ("a row of zeros", "[[1,0,0,1.5]", "[[0,0,0,1.5]", "transform_matrix"),
        ("a NaN pose", "[[1,0,0,1.5]", "[[NaN,0,0,1.5]", "transforms.json"),
        ("an overflowing pose", "[[1,0,0,1.5]", "[[1,0,0,1e999]", "transforms.json"),
        ("three rows", ",[0,0,0,1]]},", "]},", ""),
        ("no frames", "\"frames\":[{", "\"frames\":[], \"other\":[{", "no frames"),
        ("an image that is not there", "images/1.exr", "images/2.exr", "2.exr"),
    ];
    for (name, from, to, word) in spoilt {
        tally.case(
            format!("transforms.json with {name}"),
            "one error that names the place, or a note that does",
            || {
                let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
                write(folder.path(), None, false, |t| {
                    assert!(t.contains(from), "nothing to spoil: {t}");
                    t.replacen(from, to, 1)
                });
                match loaded(folder.path()) {
                    Err(e) => says(&e, &[word]),
                    // Three rows of a pose are a pose.
                    Ok(_) if name == "three rows" => Ok(()),
                    // The format's own tools skip images that are not there.
                    Ok(scene) if scene.notes.iter().any(|note| note.contains("skipped") && note.contains(word)) => {
                        Ok(())
                    }
                    Ok(_) => Err("taken".into()),
                }
            },
        );
    }
    for (name, to) in [("far away", "[[1,0,0,1e6]"), ("nearly a rotation", "[[1,0.0005,0,1.5]")] {
        tally.case(format!("transforms.json with a camera {name}"), "loads, with finite poses", || {
            let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
            write(folder.path(), None, false, |t| t.replacen("[[1,0,0,1.5]", to, 1));
            let scene = loaded(folder.path()).map_err(|e| e.to_string())?;
            ensure(scene.frames.iter().all(|f| f.camera.pose.c.is_finite() && f.camera.pose.r.is_finite()), || {
                "not finite".into()
            })
        });
    }
}
