//! Valid inputs, where a corpus starts.

use crate::run_files;
use crate::scenes::Scene;

type Seeds = Vec<(String, Vec<u8>)>;

/// Each file of a folder that inputs replace, read in each of the four ways in turn.
pub(crate) fn of_scene(scene: fn() -> Scene) -> Seeds {
    let doors = scene().doors.into_iter().enumerate();
    doors
        .map(|(i, (name, content))| {
            let content = content.unwrap_or_else(|| other(&name).into());
            (name.replace('/', "_"), [&[b'0' + i as u8, b'0' + (i % 4) as u8][..], &content].concat())
        })
        .collect()
}

/// What a file may hold that a valid folder can do without.
fn other(name: &str) -> &'static str {
    match name {
        "split.json" => r#"{"clutter":[0,1],"clean":[],"extra":[2]}"#,
        "scene.tsv" => "filename\tid\tsplit\na.png\t1\ttrain\nb.png\t2\ttest\nc.png\t\ttest\n",
        "holdout.txt" => "# names\na.png\n1.png\ntest/r_0\n",
        _ => {
            r#"{"camera_angle_x":0.7,"frames":[{"file_path":"./train/r_0","mask_path":"masks/a.png","transform_matrix":[[1.0,0.0,0.0,0.5],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0],[0.0,0.0,0.0,1.0]]}]}"#
        }
    }
}

/// The files of a run.
pub(crate) fn run_files() -> Seeds {
    let files = run_files::files().into_iter().enumerate();
    files.filter_map(|(i, (name, content))| Some((name, [&[b'0' + i as u8][..], &content?].concat()))).collect()
}

fn named(seeds: &[(&str, &str)]) -> Seeds {
    seeds.iter().map(|(name, text)| ((*name).into(), text.as_bytes().to_vec())).collect()
}

/// Both forms of a file of cameras.
pub(crate) fn camera_path() -> Seeds {
    named(&[
        (
            "frames",
            r#"0{"fl_x":10,"w":8,"h":6,"frames":[{"transform_matrix":[[1,0,0,7],[0,1,0,8],[0,0,1,9],[0,0,0,1]]},{"cx":3.5,"transform_matrix":[[1,0,0,8],[0,1,0,8],[0,0,1,9]]}]}"#,
        ),
        (
            "camera_path",
            r#"2{"render_width":80,"render_height":60,"camera_path":[{"camera_to_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],"fov":90},{"camera_to_world":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1],"fov":80}]}"#,
        ),
        ("angle", r#"1{"camera_angle_x":0.7,"frames":[{"transform_matrix":[[1,0,0,7],[0,1,0,8],[0,0,1,9]]}]}"#),
    ])
}

/// A file, and words.
pub(crate) fn config() -> Seeds {
    named(&[
        (
            "file",
            "0scene = \"/photos\"\nsystem = \"ngp\"\nseed = 0\nbackground = \"white\"\nerror_budget = 0.0\n\
             eval_appearance = \"fit\"\n\n[data]\nlongest_side = 480\nholdout = \"every:8+3\"\nmasks = \"off\"\n\
             image_memory = 512\n\n[settings]\nlr = 0.01\nlevels = 8\n",
        ),
        (
            "words",
            "1lr=1e-2\nlevels = 8\nspace=ndc\nx=[1, {a = nan}]\nevery:8+4\nnone\nimage:a b\nhold:x\npath.json\nnerfies\n",
        ),
    ])
}

/// A message of each kind.
pub(crate) fn viewer() -> Seeds {
    named(&[
        (
            "draw",
            r#"{"type":"draw","id":7,"width":80,"height":60,"position":[1,2,3],"wxyz":[1,0,0,0],"fov":1.5,"layer":"depth","limit":40,"time":0.5,"appearance":{"from":3,"blend":0.25},"background":[1,0,0],"crop":{"faint":0.1}}"#,
        ),
        (
            "pick",
            r#"{"type":"pick","id":1,"width":80,"height":60,"position":[1,2,3],"wxyz":[1,0,0,0],"fov":1.5,"at":[0,1]}"#,
        ),
        ("save", r#"{"type":"save","crop":{"box":[[-1,-1,0],[1,1,2]],"large":0.5,"up":[0,0,1]}}"#),
    ])
}
