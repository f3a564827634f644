//! Words that are agreed.

use super::*;
use crate::app::{DYNAMIC as DYNAMIC_APP, STATIC, WILD as WILD_APP};

fn read(app: &App, line: &str) -> Result<Cli, clap::Error> {
    Cli::read(app, std::iter::once(app.name).chain(line.split_whitespace()).map(Into::into))
}

#[test]
fn the_command_lines_are_consistent() {
    for app in [&STATIC, &WILD_APP] {
        Cli::of(app).debug_assert();
    }
}

const SHARED: [&str; 19] = [
    "demo --out d",
    "demo",
    "check s --holdout every:8",
    "train s --out d --system ngp --steps 10 --eval-every 5 --longest-side 100 --holdout none --background black \
     --seed 3 --threads 2 --error-budget 0.001 --set lr=0.1 --set space=ndc --image-memory 100",
    "train s --out d --seconds 60 --eval-at 10,30.5 --progress json",
    "train s --out d --train-split clean",
    "train --resume --out d",
    "eval d --lpips-weights w",
    "train s --out d --system mip-nerf --scales 4 --set width=64",
    "eval d --scales 4",
    "render d --path orbit --frames 10 --out e --layers colour,depth,opacity,normals,canonical,flow --longest-side 50",
    "render d --path hold:train/r_0 --out e",
    "render d --out e --video webm",
    "render d --path photos --out e --video off",
    "view d",
    "view d --host 0.0.0.0 --port 8080",
    "export d --points p.ply --mesh m.ply --cameras c.json --box -1,-1,-1,1,1,1",
    "export d --mesh m.glb --triangles 50000 --method tsdf --resolution 300",
    "export c.spz --mesh m.obj --look-from c.json",
];

const OF_WILD: [&str; 4] =
    ["demo --field mlp", "train s --out d --field ngp", "masks d --out m --every 4 --empty-class left-out", "masks d"];

/// Of systems for photos that differ in appearance, of a scene that stands still or that moves.
const OF_APPEARANCE: [&str; 7] = [
    "train s --out d --eval-appearance fit",
    "eval d --eval-appearance encode:whole",
    "eval d --eval-appearance image:train/r_0.png",
    "eval d --eval-appearance nearest",
    "render d --path orbit --out e --appearance mean",
    "render d --path hold:a --out e --appearance image:a..fit:../b.png --fit-camera b",
    "export d --splats a.ply --appearance image:a",
];

#[test]
fn agreed_words_are_understood() {
    for line in SHARED {
        for app in [&STATIC, &WILD_APP] {
            read(app, line).unwrap_or_else(|e| panic!("{}: {line}: {e}", app.name));
        }
    }
    for line in OF_WILD {
        read(&WILD_APP, line).unwrap_or_else(|e| panic!("{line}: {e}"));
        for app in [&STATIC, &DYNAMIC_APP] {
            let error = read(app, line).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains("word of nerf-wild:"), "{line}: {error}");
        }
    }
    for line in OF_APPEARANCE {
        for app in [&WILD_APP, &DYNAMIC_APP] {
            read(app, line).unwrap_or_else(|e| panic!("{}: {line}: {e}", app.name));
        }
        let error = read(&STATIC, line).unwrap_err();
        let of_both = error.to_string().contains("word of nerf-wild and nerf-dynamic: ");
        assert!(error.exit_code() == 2 && of_both, "{line}: {error}");
    }
    for line in [
        "train s",
        "train --out d",
        "train s --out d --steps 1 --seconds 1",
        "export d",
        "render d --out e --path circle",
        "render d --out e --video avi",
        "export d --method tsdf",
        "export d --mesh m.ply --triangles 3",
        "train s --out d --train-split dirty",
        "train s --out d --field fog",
        "train s --out d --eval-appearance encode:right",
        "render d --path orbit --out e --appearance noon",
        "render d --path orbit --out e --fit-camera b",
        "view",
        "view d --port 70000",
        "masks d --every 0",
        "masks d --empty-class two",
    ] {
        assert!(read(&WILD_APP, line).is_err(), "{line}");
    }
}

#[test]
fn priors_are_a_word_of_scenes_that_move() {
    for line in ["priors s", "priors s --out d --frames 5 --longest-side 480 --holdout every:8+4 --threads 2"] {
        read(&DYNAMIC_APP, line).unwrap_or_else(|e| panic!("{line}: {e}"));
        let error = read(&STATIC, line).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("word of nerf-dynamic"), "{line}: {error}");
    }
    assert!(read(&DYNAMIC_APP, "priors").is_err() && read(&DYNAMIC_APP, "priors s --frames 1").is_err());
    for line in ["priors s --exact --out d", "check s --priors d", "train s --out d --priors e", "eval f --priors e"] {
        read(&DYNAMIC_APP, line).unwrap_or_else(|e| panic!("{line}: {e}"));
        let error = read(&WILD_APP, line).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("word of nerf-dynamic"), "{line}: {error}");
    }
    assert!(read(&STATIC, "train s --out d --system nsff --priors e").is_ok(), "the system is one of nerf-dynamic");
}

#[test]
fn help_shows_the_words_of_the_app_alone() {
    for (app, has_masks, has_appearance) in
        [(&STATIC, false, false), (&WILD_APP, true, true), (&DYNAMIC_APP, false, true)]
    {
        let help = |line: &str| read(app, line).unwrap_err().to_string();
        assert_eq!(help("--help").contains("masks"), has_masks, "{}", app.name);
        for (line, word) in [
            ("train --help", "--eval-appearance"),
            ("eval --help", "--eval-appearance"),
            ("render --help", "--appearance"),
            ("render --help", "--fit-camera"),
            ("export --help", "--appearance"),
        ] {
            assert_eq!(help(line).contains(word), has_appearance, "{}: {line}: {word}", app.name);
        }
        assert!(help("--help").contains(app.about) && help("demo --help").contains(app.demo_folder), "{}", app.name);
    }
}

#[test]
fn help_says_what_systems_do_otherwise_than_their_papers() {
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    for app in [&STATIC, &WILD_APP, &DYNAMIC_APP] {
        for line in ["train --help", "demo --help"] {
            let help = words(&read(app, line).unwrap_err().to_string());
            for claim in systems::registry::family(app.family).map(|entry| entry.claim) {
                let said = help.contains(&words(claim.differs)) && help.contains(&words(claim.paper));
                assert!(said, "{} {line}: {}\n{help}", app.name, claim.name);
            }
        }
    }
}

#[test]
fn help_says_which_words_of_appearance_and_occluders_fields_and_clouds_have() {
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    for app in [&STATIC, &WILD_APP, &DYNAMIC_APP] {
        let help = words(&read(app, "train --help").unwrap_err().to_string());
        for said in [
            "several times On photos of many people",
            "Fields: `appearance=none|codes|encoder` and `occluders=none|robust|transient|visibility|filter|masks`;",
            "clouds: `appearance=none|codes|maps|triplane` and `occluders=none|photos|residual|errors|features|auto|visibility|visibility_head`.",
        ] {
            assert!(help.contains(said), "{}: {said}\n{help}", app.name);
        }
        let default = families::default_system(app.family);
        assert!(help.contains(&format!("Method (without it {default}).")), "{}: {default}\n{help}", app.name);
    }
}

#[test]
fn numbers_below_0_are_refused_by_what_they_may_be() {
    for (line, said) in [
        ("train s --out d --seconds -3", "write a number above 0"),
        ("train s --out d --error-budget -1", "write a number from 0 to 1"),
        ("train s --out d --steps -5", "invalid"),
        ("train s --out d --threads -2", "-2 is not in 1.."),
        ("export d --mesh m.ply --level -1", "above 0"),
        ("render d --out e --frames -1", "write a whole number"),
    ] {
        let error = read(&DYNAMIC_APP, line).unwrap_err().to_string();
        assert!(error.contains(said) && !error.contains("unexpected argument"), "{line}: {error}");
    }
    // No number is taken for an option, in any command.
    let mut seen = 0;
    for command in Cli::of(&DYNAMIC_APP).get_subcommands() {
        for arg in command.get_arguments().filter(|arg| arg.is_allow_negative_numbers_set()) {
            let Some(long) = arg.get_long() else { continue };
            let error = read(&DYNAMIC_APP, &format!("{} --{long} -7", command.get_name()));
            let error = error.map_or_else(|e| e.to_string(), |_| String::new());
            assert!(!error.contains("unexpected argument"), "{} --{long}: {error}", command.get_name());
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen} numbers found: the search is broken");
}

#[test]
fn validation_is_a_word_wherever_datasets_are_read() {
    for app in [&STATIC, &WILD_APP, &DYNAMIC_APP] {
        for line in ["check s --validation every:8", "train s --out d --holdout every:8 --validation every:8+4"] {
            read(app, line).unwrap_or_else(|e| panic!("{}: {line}: {e}", app.name));
        }
    }
}
