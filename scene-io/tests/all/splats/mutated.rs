//! Files with bytes changed, and bytes that are not files: an error or a cloud that holds together, never a panic.

use super::*;

/// What must hold of whatever is read.
fn holds_together(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    match parse(name, bytes) {
        Ok(file) => {
            prop_assert!(file.cloud.check().is_ok());
            for (_, numbers) in file.cloud.fields() {
                prop_assert!(numbers.iter().all(|x| x.is_finite()));
            }
            prop_assert!(encode_splats(Path::new("a.ply"), &file.cloud, &SplatOptions::default()).is_ok());
        }
        Err(error) => {
            let line = error.to_string();
            prop_assert!(line.contains(name) && !line.contains('\n'), "{line}");
        }
    }
    Ok(())
}

fn any_name() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec!["a.ply", "a.splat", "a.spz"])
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn random_bytes_never_panic(name in any_name(), bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        holds_together(name, &bytes)?;
    }

    #[test]
    fn changed_files_never_panic(
        name in any_name(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut: prop::sample::Index,
    ) {
        let mut bytes = encode(name, &trained::small()).0;
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        holds_together(name, &bytes)?;
        bytes.truncate(cut.index(bytes.len()));
        holds_together(name, &bytes)?;
    }

    #[test]
    fn changed_words_of_headers_never_panic(from: prop::sample::Index, to: prop::sample::Index, number: u64) {
        let bytes = encode("a.ply", &trained::small()).0;
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        let text = std::str::from_utf8(&bytes[..end]).unwrap();
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let number = number.to_string();
        for word in [words[to.index(words.len())], number.as_str()] {
            let changed = text.replacen(words[from.index(words.len())], word, 1);
            holds_together("a.ply", &[changed.as_bytes(), &bytes[end..]].concat())?;
        }
    }
}

#[test]
fn changed_trained_files_never_panic() {
    let Some(path) = trained::file() else { return };
    let ply = std::fs::read(path).unwrap();
    let cloud = parse("a.ply", &ply).unwrap().cloud;
    let (splat, spz) = (encode("a.splat", &cloud).0, encode("a.spz", &cloud).0);
    let inside = spz::inside(&spz);
    let changes = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20);
    let any_change = (0..4_usize, changes, any::<prop::sample::Index>(), any::<bool>());
    let mut runner = testkit::property::runner(48, file!());
    let result = runner.run(&any_change, |(which, changes, end, head)| {
        let mut bytes = [&ply, &splat, &spz, &inside][which].clone();
        // Half of the changes fall on what headers fill.
        let reach = if head { bytes.len().min([2000, 64, 32, 16][which]) } else { bytes.len() };
        for (at, value) in changes {
            bytes[at.index(reach)] = value;
        }
        if !head {
            bytes.truncate(end.index(bytes.len() + 1));
        }
        match which {
            0 => holds_together("a.ply", &bytes),
            1 => holds_together("a.splat", &bytes),
            2 => holds_together("a.spz", &bytes),
            _ => holds_together("a.spz", &spz::gzip(&bytes)),
        }
    });
    result.unwrap();
}

#[test]
fn every_seed_of_the_fuzzers_is_read_or_refused() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus");
    let mut read = 0;
    for (target, name) in [("splat_ply", "a.ply"), ("splat_splat", "a.splat"), ("splat_spz", "a.spz")] {
        for entry in std::fs::read_dir(corpus.join(target)).unwrap() {
            let bytes = std::fs::read(entry.unwrap().path()).unwrap();
            holds_together(name, &bytes).unwrap();
            read += usize::from(parse(name, &bytes).is_ok());
        }
    }
    assert!(read >= 3, "seeds lead to clouds: {read}");
}
