use super::*;
use crate::layout::NEAR_SHARE;
use crate::plan::made::{self, Points, RING, SIDE, capture, frames, scene};
use crate::plan::{Ground, backdrop, field_settings};
use crate::rays::{RayConfig, SamplerConfig};
use crate::samplers::OccupancyConfig;
use engine::options::Background;
use engine::options::Purpose;
use engine::train::Stop;
use glam::DVec3;
use scene_io::{Scene, TrackPoint};

fn run(set: toml::Table) -> RunOptions {
    RunOptions { seed: 0, background: None, error_budget: None, stop: None, set }
}

fn grid(config: &RayConfig) -> OccupancyConfig {
    match &config.sampler {
        SamplerConfig::Occupancy(grid) => *grid,
        SamplerConfig::Proposals(_) => panic!("an occupancy grid is planned"),
    }
}

fn field(scene: &Scene, data: &Dataset) -> RayConfig {
    let mut ground = Ground::of(scene, data, &run(toml::Table::new())).unwrap();
    field_settings(&mut ground, data)
}

#[test]
fn near_and_free_space_are_from_points_where_there_are_any() {
    let (with, data) = capture(Points::WithTracks);
    let config = field(&with, &data);
    assert!(grid(&config).free_space && grid(&config).sky, "{config:?}");
    // The floor begins about 3.16 - 1.3 before each camera.
    let near = f64::from(config.space.near) * config.space.radius;
    assert!((NEAR_SHARE * 1.5..NEAR_SHARE * 2.7).contains(&near), "{near}");
    // Who sees them is estimated where nothing says so, and makes little difference here.
    let (without, data) = capture(Points::WithoutTracks);
    assert!(data.views().iter().all(|view| !view.points.is_empty()));
    let estimated = field(&without, &data);
    assert!(
        grid(&estimated).free_space && (estimated.space.near / config.space.near - 1.0).abs() < 0.1,
        "{}",
        estimated.space.near
    );
    let (none, data) = capture(Points::None);
    let config = field(&none, &data);
    assert!(!grid(&config).free_space);
    let near = f64::from(config.space.near) * config.space.radius;
    assert!(near < 0.4 * (10.0_f64 / 9.0).sqrt() * RING, "{near}");
}

#[test]
fn two_stray_points_before_a_camera_change_nothing() {
    let (mut scene, data) = capture(Points::WithTracks);
    let near = field(&scene, &data).space.near;
    let camera = scene.frames[0].camera;
    for k in 0..2 {
        scene.points.push(scene_io::Point {
            xyz: camera.pose.c + (0.1 + 0.1 * f64::from(k)) * camera.optical_axis(),
            rgb: [0; 3],
        });
        let point = scene.points.len() as u32 - 1;
        scene.frames[0].tracks.push(TrackPoint { pixel: [12.0; 2], length: 2, point });
    }
    let (scene, data) = made::scene(scene.frames.clone(), scene.points.clone());
    let strayed = field(&scene, &data).space.near;
    assert!((strayed / near - 1.0).abs() < 0.05, "{strayed} {near}");
}

#[test]
fn depths_in_the_file_say_where_a_video_begins_and_ends() {
    let (scene, data) = made::film(Points::None);
    let moving = |scene: &Scene, data: &Dataset| {
        crate::registry::build("t-nerf", scene, data, &run(toml::toml! { occupancy = 16 })).unwrap().1.config
    };
    let unknown = moving(&scene, &data);
    let mut stated = scene.frames.clone();
    stated.iter_mut().for_each(|frame| frame.z_bounds = Some([0.5 * made::RING, 2.0 * made::RING]));
    let (scene, data) = made::scene(stated, Vec::new());
    let known = moving(&scene, &data);
    let number = |config: &toml::Table, key: &str| match &config[key] {
        toml::Value::Float(x) => *x,
        other => other.as_integer().unwrap() as f64,
    };
    // Cameras are about one unit from the centre.
    assert!((number(&known, "near") - 0.35).abs() < 0.1, "{}", number(&known, "near"));
    assert!(number(&unknown, "near") < 0.1);
    assert!(number(&known, "cascades") < number(&unknown, "cascades"), "space ends nearer");
}

#[test]
fn points_say_more_of_the_near_plane_than_the_file_and_the_file_more_than_the_cameras() {
    let near = |points: Points, stated: Option<[f64; 2]>| {
        let (scene, _) = capture(points);
        let mut frames = scene.frames;
        frames.iter_mut().for_each(|frame| frame.z_bounds = stated);
        let (scene, data) = made::scene(frames, scene.points);
        field(&scene, &data).space.near
    };
    let bounds = Some([0.9 * RING, 2.0 * RING]);
    assert!(
        (near(Points::None, bounds) / (0.9 / 0.5 * near(Points::None, Some([0.5 * RING, 2.0 * RING]))) - 1.0).abs()
            < 1e-5
    );
    assert!(near(Points::None, bounds) > 1.5 * near(Points::None, None), "not a share of the cameras' distance");
    assert_eq!(near(Points::WithTracks, bounds), near(Points::WithTracks, None), "points come first");
}

#[test]
fn static_and_wild_agree_on_the_field() {
    for points in [Points::None, Points::WithoutTracks, Points::WithTracks] {
        let (scene, data) = capture(points);
        let coarse = toml::toml! { occupancy = 16 };
        let plain = toml::toml! { appearance = "none"
        occluders = "none"
        occupancy = 16 };
        let (_, a) = build("ngp", &scene, &data, &run(coarse)).unwrap();
        let (_, b) = crate::registry::build("plain", &scene, &data, &run(plain)).unwrap();
        for (key, value) in &a.config {
            assert_eq!(Some(value), b.config.get(key), "{points:?} {key}");
        }
        assert_eq!(a.background, b.background);
        let said = |lines: &[String], what: &str| lines.iter().find(|l| l.starts_with(what)).cloned();
        for what in ["near", "free space", "sky", "empty space", "space"] {
            assert_eq!(said(&a.lines, what), said(&b.lines, what), "{points:?}");
        }
    }
}

#[test]
fn points_empty_cells_before_each_camera() {
    let (scene, data) = capture(Points::WithTracks);
    let field = |free_space: bool| {
        let mut ground = Ground::of(&scene, &data, &run(toml::Table::new())).unwrap();
        let mut config = field_settings(&mut ground, &data);
        let grid = config.occupancy_mut().unwrap();
        *grid = OccupancyConfig { free_space, occupancy: 32, ..*grid };
        ground.ngp(&data, &config, 0, None).unwrap()
    };
    let (without, with) = (field(false), field(true));
    assert!(with.carved() > without.carved(), "{:?} {:?}", with.carved(), without.carved());
    // A quarter of the way from a camera to the floor nothing can be; at the floor something can.
    let c = data.view(0).camera.pose.c;
    let points = [(0.75 * c).to_array(), DVec3::new(0.1, 0.1, 0.0).to_array()];
    let density = |ngp: &crate::rays::RaySystem| {
        let mut density = [0.0; 2];
        ngp.density(&points, 0.0, &mut density);
        density.map(|sigma| sigma > 0.0)
    };
    assert_eq!((density(&without), density(&with)), ([true, true], [false, true]));
}

#[test]
fn a_plain_backdrop_is_seen_and_anything_else_is_not() {
    let edge = |x: u32, y: u32| x == 0 || y == 0 || x == SIDE - 1 || y == SIDE - 1;
    let around = |colour: u8| frames(3, move |_, x, y| if edge(x, y) { [colour; 4] } else { [90, 30, 60, 255] });
    let found = |frames| backdrop(&scene(frames, Vec::new()).1).unwrap();
    let white = found(around(250)).unwrap();
    assert_eq!(white.background, Background::White);
    assert!(white.line.contains("12 of 12"), "{}", white.line);
    assert_eq!(found(around(3)).unwrap().background, Background::Black);
    assert_eq!(found(around(128)), None, "grey is not one of the backgrounds");
    assert_eq!(found(around(220)), None);
    // One photo of twelve may differ, three may not.
    let but = |few: usize| frames(3, move |k, x, y| if edge(x, y) && k >= few { [255; 4] } else { [90, 30, 60, 255] });
    assert!(found(but(1)).is_some() && found(but(3)).is_none());
    // White and black in turn are not a backdrop, nor is a white edge with alpha.
    assert_eq!(found(frames(3, |k, _, _| [255 * (k % 2) as u8; 4])), None);
    assert_eq!(found(frames(4, |_, _, _| [255; 4])), None);
    let (white, data) = scene(around(255), Vec::new());
    let coarse = || toml::toml! { occupancy = 16 };
    let (_, plan) = build("ngp", &white, &data, &run(coarse())).unwrap();
    assert_eq!(plan.background, Background::White);
    assert_eq!(plan.config["sky"].as_bool(), Some(false));
    let said = RunOptions { background: Some(Background::Random), ..run(coarse()) };
    assert_eq!(build("ngp", &white, &data, &said).unwrap().1.background, Background::Random);
}

#[test]
fn a_setting_of_one_system_alone_implies_it() {
    let (scene, data) = capture(Points::None);
    let chosen = |set| {
        choose(&scene, &data, &RunOptions { stop: Some(Stop::Steps(9)), ..run(set) }, Purpose::Geometry)
            .map(|c| c.system)
    };
    assert_eq!(chosen(toml::Table::new()).unwrap(), "ngp");
    assert_eq!(chosen(toml::toml! { max_splats = 100 }).unwrap(), "splat");
    assert_eq!(chosen(toml::toml! { log2_table = 12 }).unwrap(), "ngp");
    assert_eq!(chosen(toml::toml! { sh_degree = 1 }).unwrap(), "ngp", "both have it");
    let error = chosen(toml::toml! { max_splats = 100
    n_max = 64 })
    .unwrap_err()
    .to_string();
    assert!(error.contains("max_splats") && error.contains("n_max") && error.contains("--system"), "{error}");
}

#[test]
fn points_all_over_the_pictures_make_a_cloud() {
    let set = || run(toml::Table::new());
    let chosen = |points, purpose| {
        let (scene, data) = capture(points);
        choose(&scene, &data, &set(), purpose).unwrap()
    };
    assert_eq!(chosen(Points::None, Purpose::Viewing).system, "ngp");
    assert_eq!(chosen(Points::WithTracks, Purpose::Geometry).system, "ngp");
    let line = chosen(Points::WithTracks, Purpose::Viewing).line;
    assert!(line.starts_with("system: ") && line.contains("600 points"), "{line}");
}

#[test]
fn every_app_takes_every_system_that_fits_the_scene() {
    let (photos, data) = capture(Points::None);
    let (film, frames) = made::film(Points::None);
    let coarse = || run(toml::toml! { occupancy = 16 });
    // A cloud has no grid.
    let small =
        |name: &str| if ["4dgs", "degauss"].contains(&name) { run(toml::toml! { max_splats = 100 }) } else { coarse() };
    for name in names(Family::Moving) {
        let built = build(name, &photos, &data, &small(name));
        if find(name).unwrap().needs == Needs::Photos {
            assert_eq!(built.unwrap().0.name(), name);
        } else {
            let line = built.err().expect("photos without times do not fit").to_string();
            assert!(line.contains(name) && line.contains("no photo has a time"), "{line}");
        }
        assert_eq!(build(name, &film, &frames, &small(name)).unwrap().0.name(), name);
    }
    // Of a video, too, they show one scene with occluders.
    assert_eq!(build("nerf-w", &film, &frames, &coarse()).unwrap().0.name(), "nerf-w");
}

#[test]
fn plans_of_scene_flow_say_which_priors_are_missing() {
    let (film, frames) = made::film(Points::None);
    for name in ["nsff", "dynamic-nerf"] {
        let (_, plan) = build(name, &film, &frames, &run(toml::toml! { occupancy = 16 })).unwrap();
        let lines = plan.lines.join("\n");
        for said in ["background: a field of what stands still", "no optical flow", "no disparities", "no motion masks"]
        {
            assert!(lines.contains(said), "{name}: {lines}");
        }
    }
}

#[test]
fn every_system_stands_once_and_is_of_a_family() {
    let all: std::collections::HashSet<&str> = entries().iter().map(|entry| entry.claim.name).collect();
    assert_eq!(all.len(), entries().len());
    let families = [Family::Static, Family::Wild, Family::Moving];
    let listed: std::collections::HashSet<&str> = families.into_iter().flat_map(names).collect();
    assert_eq!(all, listed);
    let (photos, data) = capture(Points::None);
    let line = build("nerfstudio", &photos, &data, &run(toml::Table::new())).err().unwrap().to_string();
    assert!(line.contains("ngp") && line.contains("nerf-w") && line.contains("tineuvox"), "{line}");
}
