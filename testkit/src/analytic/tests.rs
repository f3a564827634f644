use super::*;

#[track_caller]
fn close(got: f64, want: f64, tolerance: f64, what: &str) {
    assert!((got - want).abs() <= tolerance * want.abs().max(1.0), "{what}: got {got:e}, want {want:e}");
}

#[test]
fn the_kronrod_rule_is_exact_up_to_degree_22_and_the_gauss_rule_up_to_13() {
    // Without halving: an endless tolerance.
    for degree in 0..=22 {
        let want = if degree % 2 == 0 { 2.0 / f64::from(degree + 1) } else { 0.0 };
        close(integrate(-1.0, 1.0, f64::INFINITY, |x| x.powi(degree)), want, 2e-15, "kronrod");
        let gauss: f64 = integrate::gauss_alone(|x| x.powi(degree));
        if degree <= 13 {
            close(gauss, want, 2e-15, "gauss");
        }
    }
    assert!((integrate(-1.0, 1.0, f64::INFINITY, |x| x.powi(24)) - 2.0 / 25.0).abs() > 1e-12);
}

#[test]
fn known_integrals() {
    close(integrate(0.0, 1.0, 1e-14, |x| x.sqrt()), 2.0 / 3.0, 1e-13, "a corner at the end");
    close(integrate(0.0, 1.0, 1e-14, |x| f64::from(x > 0.3)), 0.7, 1e-12, "a jump");
    close(integrate(0.0, 50.0, 1e-14, |x| (-x * x).exp()), 0.5 * std::f64::consts::PI.sqrt(), 1e-14, "a narrow bump");
    close(integrate(0.0, 3.0, 1e-14, |x| (20.0 * x).sin()), (1.0 - 60_f64.cos()) / 20.0, 1e-14, "waves");
    assert_eq!(integrate(1.0, 1.0, 1e-14, |x| x), 0.0);
}

#[test]
fn optical_depths_are_the_integrals_of_the_densities() {
    for field in Field::all() {
        for [from, to] in [[2.0, 6.0], [2.1, 2.2], [3.0, 5.0], [5.5, 6.0], [4.0, 4.0]] {
            let mut edges = field.density.breaks();
            edges.retain(|t| from < *t && *t < to);
            edges.extend([from, to]);
            edges.sort_by(f64::total_cmp);
            let want: f64 = edges
                .windows(2)
                .map(|e| integrate(e[0], e[1], 1e-15, |t| field.density.at(t.min(e[1].next_down()))))
                .sum();
            close(field.density.depth(from, to), want, 1e-13, field.name);
        }
    }
}

#[test]
fn a_constant_colour_shows_the_opacity() {
    for mut field in Field::all() {
        field.colour = [vec![1.0], vec![0.25], vec![0.0]];
        field.background = [0.0, 0.25, 1.0];
        let pixel = field.pixel();
        close(pixel.colour[0], 1.0 - pixel.trans_end, 1e-13, field.name);
        close(pixel.colour[1], 0.25, 1e-13, field.name);
        close(pixel.colour[2], pixel.trans_end, 1e-15, field.name);
    }
}

#[test]
fn the_closed_form_of_steps_is_the_integral() {
    for field in Field::all().iter().filter(|f| f.density.is_step()) {
        let pixel = field.pixel();
        let mut edges = field.density.breaks();
        edges.extend(field.span);
        edges.sort_by(f64::total_cmp);
        for c in 0..3 {
            let light: f64 = edges
                .windows(2)
                .map(|e| {
                    integrate(e[0], e[1], 1e-15, |t| {
                        let trans = (-field.density.depth(2.0, t)).exp();
                        trans * field.density.at(t.min(e[1].next_down())) * field.colour_at(t)[c]
                    })
                })
                .sum();
            close(pixel.colour[c], light + pixel.trans_end * 0.5, 1e-13, field.name);
        }
    }
}

#[test]
fn a_ray_is_the_front_part_before_the_back_part() {
    for field in Field::all() {
        let (whole, front, back) = (field.pixel(), field.pixel_between([2.0, 4.05]), field.pixel_between([4.05, 6.0]));
        close(front.trans_end * back.trans_end, whole.trans_end, 1e-14, field.name);
        for c in 0..3 {
            let behind = front.colour[c] - front.trans_end * field.background[c] + front.trans_end * back.colour[c];
            close(behind, whole.colour[c], 1e-13, field.name);
        }
    }
}

#[test]
fn the_fields_are_what_their_docs_say() {
    let fields = Field::all();
    let jumps: Vec<&str> = fields.iter().filter(|f| !f.density.is_smooth()).map(|f| f.name).collect();
    assert_eq!(jumps, ["slab", "steps"]);
    for field in &fields {
        for k in 0..=400 {
            let t = 2.0 + 0.01 * f64::from(k);
            assert!(field.density.at(t) >= 0.0, "{} at {t}", field.name);
            assert!(
                field.colour_at(t).iter().all(|c| (0.0..=1.0).contains(c)),
                "{} at {t}: {:?}",
                field.name,
                field.colour_at(t)
            );
        }
        // Something is seen, and not at once.
        let pixel = field.pixel();
        assert!(pixel.trans_end < 0.5, "{} lets {} through", field.name, pixel.trans_end);
    }
    // Empty parts of the ray show what is behind.
    assert_eq!(fields[0].pixel_between([3.0, 3.0]), Pixel { colour: [0.5; 3], trans_end: 1.0 });
}
