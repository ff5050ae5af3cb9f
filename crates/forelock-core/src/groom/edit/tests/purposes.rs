//! Tests of each operation's purpose.

use glam::Vec3;

use super::*;

/// The groom after `operation`, without a body.
fn edited(groom: &Groom, operation: Operation) -> Groom {
    let mut groom = groom.clone();
    Edit::all(operation).apply(&mut groom, None).unwrap();
    groom
}

/// `count` strands of 41 particles, straight down for 20 cm, in a row along x 4 mm apart.
fn straight(count: usize) -> Groom {
    let strand = |s: usize| (0..41).map(move |i| Vec3::new(0.004 * s as f32, -0.005 * i as f32, 0.0));
    Groom::from_strands((0..count).map(|s| strand(s).collect::<Vec<_>>())).unwrap()
}

/// Straightness of a strand: the distance from root to tip divided by the length.
fn straightness(groom: &Groom, strand: usize) -> f32 {
    let points = groom.strand(strand);
    points[0].distance(points[points.len() - 1]) / groom.length(strand)
}

#[test]
fn trimmed_strands_have_the_requested_length_and_their_attributes() {
    let mut start = straight(2);
    start.widths = Some((0..82).map(|i| (i % 41) as f32).collect());
    start.pinned = Some(vec![3, 40]);
    let trimmed = edited(&start, Operation::Trim(Trim { to: 0.1025, ..Trim::default() }));
    assert!((trimmed.length(0) - 0.1025).abs() < 1e-6);
    assert_eq!(trimmed.strand(0)[..21], start.strand(0)[..21]);
    let widths = trimmed.widths.as_ref().unwrap();
    assert!((widths[21] - 20.5).abs() < 1e-3, "the tip's width is interpolated: {}", widths[21]);
    assert_eq!(trimmed.pinned, Some(vec![3, 22]));
    // A remaining edge shorter than a tenth is not kept.
    let close = edited(&start, Operation::Trim(Trim { to: 0.1002, ..Trim::default() }));
    assert_eq!(close.strand(0).len(), 21);
    let stub = edited(&start, Operation::Trim(Trim { by: 9.0, ..Trim::default() }));
    assert!((stub.length(0) - 0.002).abs() < 1e-7 && stub.strand(0).len() == 2);
}

#[test]
fn a_plane_cuts_all_tips_at_its_height() {
    let plane = HalfSpace { point: Vec3::NEG_Y * 0.123, normal: Vec3::NEG_Y };
    let cut = edited(&straight(9), Operation::Cut(Cut::new(CutShape::Plane(plane))));
    for strand in cut.strands() {
        assert!((strand[strand.len() - 1].y + 0.123).abs() < 1e-5);
    }
}

#[test]
fn a_helix_continues_as_the_same_helix() {
    let at = |i: usize| {
        let angle = 0.4 * i as f32;
        Vec3::new(0.01 * angle.cos(), -0.002 * angle, 0.01 * angle.sin())
    };
    let start = Groom::from_strands([(0..40).map(at).collect::<Vec<_>>()]).unwrap();
    let longer = edited(&start, Operation::Lengthen(Lengthen { factor: 1.0 + 30.0 / 39.0, by: 0.0 }));
    assert_eq!(longer.strand(0)[..40], *start.strand(0));
    assert_eq!(longer.strand(0).len(), 70);
    for (i, point) in longer.strand(0).iter().enumerate() {
        // Positions are rounded to 1e-9 m and bends therefore to 1e-6; thirty edges of 4 mm
        // accumulate this.
        assert!(point.distance(at(i)) < 2e-5, "particle {i} is {} off", point.distance(at(i)));
    }
    let some = edited(&start, Operation::Lengthen(Lengthen { by: 0.0333, factor: 1.0 }));
    assert!((some.length(0) - start.length(0) - 0.0333).abs() < 1e-6);
    let little = edited(&start, Operation::Lengthen(Lengthen { by: 0.001, factor: 1.0 }));
    assert_eq!(little.strand(0).len(), 40);
    assert!((little.length(0) - start.length(0) - 0.001).abs() < 1e-6);
    let most = edited(&start, Operation::Lengthen(Lengthen { by: 20.0, factor: 1.0 }));
    assert_eq!(most.strand(0).len(), 1000);
}

#[test]
fn combed_hair_runs_along_the_stroke_and_keeps_its_waves() {
    let comb =
        Comb { radius: 0.3, ..Comb::along(vec![Vec3::new(-1.0, -0.1, 0.0), Vec3::new(1.0, -0.1, 0.0)]) };
    let straight = straight(3);
    let combed = edited(&straight, Operation::Comb(comb.clone()));
    for strand in combed.strands() {
        // The falloff (1 - (0.1/0.3)^2)^2 at the root is 0.79; from there on the strand bends
        // towards the stroke.
        let along = (strand[40] - strand[5]).normalize();
        assert!(along.x > 0.9, "{along}");
    }
    let wave = Curl { kind: CurlKind::Wave, wavelength: 0.03, full: 0.0, ..Curl::default() };
    let wavy = edited(&straight, Operation::Curl(wave));
    let kept = edited(&wavy, Operation::Comb(Comb { detail: 0.06, ..comb.clone() }));
    let lost = edited(&wavy, Operation::Comb(Comb { detail: 0.0, ..comb }));
    let [before, kept, lost] = [&wavy, &kept, &lost].map(|groom| straightness(groom, 1));
    assert!((kept - before).abs() < 0.05 && lost > before + 0.05, "{before} {kept} {lost}");
}

#[test]
fn points_attract_and_repel() {
    let start = straight(1);
    let centre = Vec3::new(0.02, -0.1, 0.0);
    let nearest = |groom: &Groom| groom.strand(0).iter().map(|p| p.distance(centre)).fold(1.0, f32::min);
    let drawn = edited(&start, Operation::Attract(Pull { radius: 0.06, ..Pull::about(centre) }));
    assert!(nearest(&drawn) < 0.015, "{}", nearest(&drawn));
    let pushed = edited(&start, Operation::Repel(Pull { radius: 0.06, strength: 1.0, centre }));
    assert!(nearest(&pushed) > 0.05, "{}", nearest(&pushed));
}

#[test]
fn a_curl_is_a_helix_of_its_radius_and_wavelength_and_straightening_removes_it() {
    let fine = edited(&straight(1), Operation::Resample(Resample { particles: 400 }));
    let curl = Curl { radius: 0.006, wavelength: 0.04, full: 0.0, ..Curl::default() };
    let curled = edited(&fine, Operation::Curl(curl));
    let points = curled.strand(0);
    // Extent from root to tip along the axis: λ/L of the length.
    let arc = (std::f32::consts::TAU * 0.006).hypot(0.04);
    assert!(((points[0].y - points[399].y) / 0.2 - 0.04 / arc).abs() < 0.01);
    let wide = |axis: usize| {
        let (lo, hi) =
            points.iter().fold((1.0f32, -1.0f32), |(lo, hi), p| (lo.min(p[axis]), hi.max(p[axis])));
        hi - lo
    };
    assert!((wide(0) - 0.012).abs() < 6e-4 && (wide(2) - 0.012).abs() < 6e-4, "{} {}", wide(0), wide(2));
    let ironed = edited(&curled, Operation::Straighten(Straighten { reach: 0.1, ..Straighten::default() }));
    assert!(straightness(&curled, 0) < 0.75 && straightness(&ironed, 0) > 0.97);
    let mut coarse = straight(1);
    let fine = Operation::Curl(Curl { wavelength: 0.01, radius: 0.001, ..Curl::default() });
    assert_eq!(Edit::all(fine).apply(&mut coarse, None).unwrap().coarse, 1);
}

#[test]
fn a_roll_is_an_arc_towards_its_centre() {
    let roll = Curl {
        kind: CurlKind::Roll,
        radius: 0.1,
        full: 0.0,
        centre: Some(Vec3::new(1.0, 0.0, 0.0)),
        ..Curl::default()
    };
    let rolled = edited(&straight(1), Operation::Curl(roll));
    let (tip, angle) = (rolled.strand(0)[40], 2.0f32);
    let expected = Vec3::new(0.1 * (1.0 - angle.cos()), -0.1 * angle.sin(), 0.0);
    assert!(tip.distance(expected) < 2e-4, "{tip} is not {expected}");
}

#[test]
fn clumping_gathers_the_tips_of_a_lock() {
    let start = straight(20);
    let clump = Clump { spacing: 0.03, tip: 0.9, flyaways: 0.0, ..Clump::default() };
    let clumped = edited(&start, Operation::Clump(clump));
    // Median distance between neighbouring strands, which ignores the few gaps between locks.
    let apart = |groom: &Groom, i: usize| {
        let mut gaps: Vec<f32> =
            (1..20).map(|s| groom.strand(s)[i].distance(groom.strand(s - 1)[i])).collect();
        gaps.sort_by(f32::total_cmp);
        gaps[9]
    };
    assert!(apart(&clumped, 40) < 0.4 * apart(&start, 40), "{}", apart(&clumped, 40));
    assert!(apart(&clumped, 2) > 0.8 * apart(&start, 2));
}

#[test]
fn new_strands_lie_between_the_old_ones_and_keep_their_curl() {
    let curl = Curl { wavelength: 0.04, ..Curl::default() };
    let start = edited(&straight(30), Operation::Curl(curl));
    let mut thick = start.clone();
    let edit = Edit::all(Operation::Density(Density { factor: 3.0, ..Density::default() }));
    let report = edit.apply(&mut thick, None).unwrap();
    assert_eq!((thick.strand_count(), report.added, report.changed), (90, 60, 0));
    for s in 0..90 {
        if s < 30 {
            assert_eq!(thick.strand(s), start.strand(s));
        }
        let root = thick.strand(s)[0];
        assert!(root.x >= 0.0 && root.x <= 0.004 * 29.0 + 1e-6 && root.y.abs() < 1e-6);
        assert!((thick.length(s) - 0.2).abs() < 1e-4);
        assert!(straightness(&thick, s) < straightness(&start, 0) + 0.1, "strand {s} lost its curl");
    }
    let thin = edited(&start, Operation::Density(Density { factor: 0.3, ..Density::default() }));
    assert_eq!(thin.strand_count(), 9);
    assert!(thin.strands().all(|s| start.strands().any(|t| s == t)));
}

#[test]
fn mirroring_twice_restores_the_groom() {
    let start = groom(&[9; 20], 3);
    let flip = Mirror { mode: MirrorMode::Flip, normal: Vec3::new(1.0, 0.2, -0.7), ..Mirror::default() };
    let once = edited(&start, Operation::Mirror(flip));
    let twice = edited(&once, Operation::Mirror(flip));
    let rounding = 4.0 * f32::EPSILON * 0.2;
    assert!(start.positions().iter().zip(twice.positions()).all(|(a, b)| a.distance(*b) < rounding));
    assert!(start.positions().iter().zip(once.positions()).any(|(a, b)| a.distance(*b) > 0.01));

    let replaced = edited(&start, Operation::Mirror(Mirror::default()));
    let right = (0..20).filter(|&s| start.strand(s)[0].x > 0.0).count();
    assert_eq!(replaced.strand_count(), 2 * right);
    let image = |p: &Vec3| Vec3::new(-p.x, p.y, p.z);
    for s in 0..right {
        assert!(replaced.strand(s).iter().map(image).eq(replaced.strand(s + right).iter().copied()));
        assert_eq!(replaced.stiffness.as_ref().unwrap()[s], replaced.stiffness.as_ref().unwrap()[s + right]);
    }
    let added = edited(&start, Operation::Mirror(Mirror { mode: MirrorMode::Add, ..Mirror::default() }));
    assert_eq!(added.strand_count(), 20 + right);
    assert!(replaced.bindings.is_none(), "bindings must be dropped if roots cannot be bound");
}

#[test]
fn smoothing_reduces_kinks_and_differences_between_neighbours() {
    let mut rough = straight(20);
    let mut random = Random::new(5, 5);
    for s in 0..20 {
        let range = rough.range(s);
        for p in rough.positions_mut()[range].iter_mut().skip(1) {
            *p += random.cube() * 0.001;
        }
    }
    let bend = |groom: &Groom| -> f32 {
        let bends = groom
            .strands()
            .flat_map(|s| s.windows(3).map(|w| (w[1] - w[0]).angle_between(w[2] - w[1])).collect::<Vec<_>>());
        bends.sum()
    };
    let smooth = edited(&rough, Operation::Smooth(Smooth { amount: 1.0, along: 0.02, across: 0.0 }));
    assert!(bend(&smooth) < 0.3 * bend(&rough), "{} {}", bend(&smooth), bend(&rough));
    let across = edited(&rough, Operation::Smooth(Smooth { amount: 1.0, along: 0.0, across: 0.03 }));
    assert!(bend(&across) < 0.6 * bend(&rough), "{} {}", bend(&across), bend(&rough));
}

/// Users read the documented defaults, so they must equal the actual ones.
#[test]
fn documented_defaults_equal_the_defaults() {
    let plain = |text: &str| {
        let text = text.replace("Vec3(", "[").replace(')', "]");
        let end =
            if text.starts_with('[') { text.find(']').map(|at| at + 1) } else { text.find([',', ';', ' ']) };
        let text = text[..end.unwrap_or(text.len())].trim_matches(['"', '.', '[', ']']).to_lowercase();
        let numbers: Result<Vec<f32>, _> = text.split(", ").map(str::parse).collect();
        numbers.map_err(|_| text)
    };
    let plane = HalfSpace { point: Vec3::ZERO, normal: Vec3::Y };
    let all = [
        ("Trim", include_str!("../cut.rs"), format!("{:?}", Trim::default())),
        ("Cut", include_str!("../cut.rs"), format!("{:?}", Cut::new(CutShape::Plane(plane)))),
        ("Lengthen", include_str!("../lengthen.rs"), format!("{:?}", Lengthen::default())),
        ("Resample", include_str!("../lengthen.rs"), format!("{:?}", Resample::default())),
        ("Comb", include_str!("../comb.rs"), format!("{:?}", Comb::along(Vec::new()))),
        ("Pull", include_str!("../pull.rs"), format!("{:?}", Pull::about(Vec3::ZERO))),
        ("Curl", include_str!("../curl.rs"), format!("{:?}", Curl::default())),
        ("Straighten", include_str!("../curl.rs"), format!("{:?}", Straighten::default())),
        ("Clump", include_str!("../clump.rs"), format!("{:?}", Clump::default())),
        ("Density", include_str!("../density.rs"), format!("{:?}", Density::default())),
        ("Mirror", include_str!("../mirror.rs"), format!("{:?}", Mirror::default())),
        ("Smooth", include_str!("../smooth.rs"), format!("{:?}", Smooth::default())),
        ("Selection", include_str!("../selection.rs"), format!("{:?}", Selection::default())),
    ];
    let mut compared = 0;
    for (name, source, shown) in all {
        let (_, body) = source.split_once(&format!("pub struct {name} {{")).unwrap();
        let mut doc = String::new();
        for line in body.split("\n}").next().unwrap().lines().map(str::trim) {
            if let Some(text) = line.strip_prefix("///") {
                doc.push_str(text);
            }
            let Some((field, _)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(':')) else {
                continue;
            };
            let doc = std::mem::take(&mut doc);
            let actual = shown.split_once(&format!(" {field}: ")).unwrap().1;
            if doc.contains("o default") || actual.starts_with("None") {
                continue;
            }
            let documented =
                doc.split_once("efault ").unwrap_or_else(|| panic!("{name}.{field} documents no default")).1;
            assert_eq!(plain(documented), plain(actual), "{name}.{field}");
            compared += 1;
        }
    }
    assert!(compared > 35, "only {compared} defaults were found");
}
