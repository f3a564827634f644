//! What every system says of itself, in its claim and where it starts.

use super::{Needs, build, entries, find};
use crate::claims::Claim;
use crate::plan::made::{Points, capture, film};
use engine::options::RunOptions;

/// Names that are not of a paper.
const OWN: [&str; 3] = ["auto", "plain", "two-parts"];

fn all() -> impl Iterator<Item = Claim> {
    entries().iter().flat_map(|entry| entry.claims())
}

#[test]
fn every_system_with_a_paper_s_name_says_what_differs_in_a_sentence_or_two() {
    for claim in all() {
        assert_eq!(claim.is_of_a_paper(), !OWN.contains(&claim.name), "{}", claim.name);
        assert!(claim.differs.ends_with('.'), "{}: {}", claim.name, claim.differs);
        let sentences = claim.differs.matches(". ").count() + 1;
        assert!(sentences <= 3 && claim.differs.len() <= 420, "{}: {}", claim.name, claim.differs);
        for text in [claim.what, claim.take] {
            assert!(
                (5..180).contains(&text.len()) && !text.ends_with('.'),
                "{}: a cell of a table: {text}",
                claim.name
            );
        }
        if claim.is_of_a_paper() {
            assert!((5..60).contains(&claim.mark.len()), "{}: {}", claim.name, claim.mark);
            assert!(claim.line().unwrap().contains(claim.differs));
        }
    }
    assert_eq!(find("hugs").unwrap().claim.name, "hugs");
    assert!(find("nerfstudio").is_none());
}

#[test]
fn plans_say_it_where_the_system_starts() {
    let (scene, data) = capture(Points::WithTracks);
    let run =
        |set: &str| RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.parse().unwrap() };
    let mut seen = 0;
    let mut check = |claim: Claim, lines: &[String]| {
        seen += 1;
        match claim.line() {
            Some(line) => assert!(lines.contains(&line), "{}: {lines:#?}", claim.name),
            None => assert!(!lines.iter().any(|l| l.contains("as published (")), "{}: {lines:#?}", claim.name),
        }
    };
    let (video, frames) = film(Points::WithTracks);
    for entry in entries() {
        // What photos need is given: to find it takes a training.
        let set = match entry.claim.name {
            "auto" => "appearance = 'none'\noccluders = 'none'",
            "nerfies" | "hypernerf" => "appearance = 'none'",
            _ => "",
        };
        let (scene, data) = if entry.needs == Needs::Times { (&video, &frames) } else { (&scene, &data) };
        check(entry.claim, &build(entry.claim.name, scene, data, &run(set)).unwrap().1.lines);
        if let Some(claim) = entry.on_networks {
            let set = "field = 'mlp'\nwidth = 16\nwarp_width = 16";
            assert_eq!(entry.claim_with(&set.parse().unwrap()), claim);
            check(claim, &build(entry.claim.name, scene, data, &run(set)).unwrap().1.lines);
        }
        assert_eq!(entry.claim_with(&toml::Table::new()), entry.claim);
    }
    assert_eq!(seen, all().count());
}
