//! Columns that enter a regression linearly, in addition to the polynomial of x: their figures, and the refusal of
//! columns that say the same.

use isotherm_statistics::{
    DataPoint, DoubleDouble, LinearColumn, OrderTable, Regression, RegressionError, Rule, choose, default_order,
};

/// Longley's data, J. Am. Statist. Assoc. 62 (1967) 819, as in NIST's set of this name: total employment, price index
/// (1954 = 100), gross national product, unemployed, armed forces, population, year.
const LONGLEY: [[&str; 7]; 16] = [
    ["60323", "83.0", "234289", "2356", "1590", "107608", "1947"],
    ["61122", "88.5", "259426", "2325", "1456", "108632", "1948"],
    ["60171", "88.2", "258054", "3682", "1616", "109773", "1949"],
    ["61187", "89.5", "284599", "3351", "1650", "110929", "1950"],
    ["63221", "96.2", "328975", "2099", "3099", "112075", "1951"],
    ["63639", "98.1", "346999", "1932", "3594", "113270", "1952"],
    ["64989", "99.0", "365385", "1870", "3547", "115094", "1953"],
    ["63761", "100.0", "363112", "3578", "3350", "116219", "1954"],
    ["66019", "101.2", "397469", "2904", "3048", "117388", "1955"],
    ["67857", "104.6", "419180", "2822", "2857", "118734", "1956"],
    ["68169", "108.4", "442769", "2936", "2798", "120445", "1957"],
    ["66513", "110.8", "444546", "4681", "2637", "121950", "1958"],
    ["68655", "112.6", "482704", "3813", "2552", "123366", "1959"],
    ["69564", "114.2", "502601", "3931", "2514", "125368", "1960"],
    ["69331", "115.7", "518173", "4806", "2572", "127852", "1961"],
    ["70551", "116.9", "554894", "4007", "2827", "130081", "1962"],
];

fn number(text: &str) -> DoubleDouble {
    DoubleDouble::parse(text).unwrap()
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}

/// Points of weight 1.
fn points(x: &[DoubleDouble], y: impl Fn(usize) -> DoubleDouble) -> Vec<DataPoint> {
    let point = |(index, &x): (usize, &DoubleDouble)| DataPoint { x, y: y(index), weight: DoubleDouble::ONE };
    x.iter().enumerate().map(point).collect()
}

fn column(name: &str, values: &[DoubleDouble]) -> LinearColumn {
    LinearColumn { name: name.to_owned(), values: values.to_vec() }
}

/// Scatter between -1 and 1, without pattern.
fn scatter(index: usize) -> f64 {
    libm::sin(1e4 * (index as f64 + 0.5))
}

/// Temperature that heats and cools twice, and the same behind a lag, with this many decimals.
fn temperature(decimals: usize) -> (Vec<DoubleDouble>, Vec<DoubleDouble>) {
    let u = |i: usize| 2.5 - 1.4 * libm::cos(i as f64 / 20.0);
    let lagged = |i: usize| 2.5 - 1.4 * libm::cos(i as f64 / 20.0 - 0.2) + 0.02 * libm::sin(i as f64 / 7.0);
    let written = |value: f64| number(&format!("{value:.decimals$}"));
    ((0..250).map(|i| written(u(i))).collect(), (0..250).map(|i| written(lagged(i))).collect())
}

#[test]
fn longleys_data_have_their_certified_figures() {
    let of = |index: usize| LONGLEY.map(|row| number(row[index])).to_vec();
    let names = ["price index", "product", "unemployed", "forces", "population"];
    let linear = names.iter().zip(1..).map(|(name, index)| column(name, &of(index))).collect();
    let years = of(6);
    let employed = of(0);
    let regression = Regression::with_linear(points(&years, |i| employed[i]), "year", linear, 1).unwrap();
    let fit = &regression.fits()[1];
    // The certified coefficients and their standard deviations, then 1/(1 - R^2) of each column on the others.
    for (term, right) in fit.linear.iter().zip([
        [15.061_872_271_373_3, 84.914_925_774_766_9, 135.532_438_280_003],
        [-0.358_191_792_925_910e-1, 0.334_910_077_722_432e-1, 1_788.513_482_718_18],
        [-2.020_229_803_816_83, 0.488_399_681_651_699, 33.618_890_596_050],
        [-1.033_226_867_173_59, 0.214_274_163_161_675, 3.588_930_193_446],
        [-0.511_041_056_535_807e-1, 0.226_073_200_069_370, 399.151_022_312_640],
    ]) {
        for (got, right, digits) in [
            (term.coefficient, right[0], 1e-13),
            (term.standard_error.unwrap(), right[1], 1e-13),
            (term.variance_inflation, right[2], 1e-12),
        ] {
            assert!(close(got, right, digits), "{}: {got} {right}", term.column);
        }
        let f = (term.coefficient / term.standard_error.unwrap()).powi(2);
        assert!(close(term.f.unwrap(), f, 1e-13), "{f}");
    }
    for (got, right) in [
        (fit.coefficients[0], -3_482_258.634_595_82),
        (fit.coefficients[1], 1_829.151_464_613_55),
        (fit.standard_errors.as_ref().unwrap()[0], 890_420.383_607_373),
        (fit.standard_errors.as_ref().unwrap()[1], 455.478_499_142_212),
        (fit.residual_sd.unwrap(), 304.854_073_561_965),
        (fit.r_squared.unwrap(), 0.995_479_004_577_296),
        (fit.f.unwrap(), 330.285_339_234_588),
    ] {
        assert!(close(got, right, 1e-13), "{got} {right}");
    }
    assert_eq!(fit.df_residual, 9);
}

#[test]
fn a_linear_column_of_squares_is_the_next_order() {
    let x: Vec<_> = (0..30).map(|i| DoubleDouble::from(0.1 * f64::from(i) + 1.1)).collect();
    let squares: Vec<_> = x.iter().map(|&x| x * x).collect();
    let y = |i: usize| DoubleDouble::from(3.0 + scatter(i)) + x[i] - squares[i];
    let powers = Regression::new(points(&x, y), 2).unwrap();
    let columns = Regression::with_linear(points(&x, y), "x", vec![column("square", &squares)], 1).unwrap();
    let (power, both) = (&powers.fits()[2], &columns.fits()[1]);
    let square = &both.linear[0];
    let last = power.partial.last().unwrap();
    for (a, b) in [
        (both.coefficients[0], power.coefficients[0]),
        (both.coefficients[1], power.coefficients[1]),
        (square.coefficient, power.coefficients[2]),
        (square.standard_error.unwrap(), power.standard_errors.as_ref().unwrap()[2]),
        (square.f.unwrap(), last.f.unwrap()),
        (square.p.unwrap(), last.p.unwrap()),
        (square.sum_of_squares, last.sum_of_squares),
        (both.partial[0].sum_of_squares, power.partial[0].sum_of_squares),
        (both.f.unwrap(), power.f.unwrap()),
        (both.f_p.unwrap(), power.f_p.unwrap()),
        (both.adj_r_squared.unwrap(), power.adj_r_squared.unwrap()),
        (both.sse, power.sse),
        (both.leave_one_out_rms.unwrap(), power.leave_one_out_rms.unwrap()),
        (both.leave_one_out_max.unwrap(), power.leave_one_out_max.unwrap()),
    ] {
        assert!(close(a, b, 1e-12), "{a} {b}");
    }
    let residuals = columns.residuals(1).into_iter().zip(powers.residuals(2));
    assert!(residuals.map(|(a, b)| (a - b).abs()).all(|difference| difference < 1e-13));
    // Without x, a line in the column.
    let alone = Regression::new(points(&squares, y), 1).unwrap();
    let order_0 = &columns.fits()[0];
    assert!(close(order_0.linear[0].coefficient, alone.fits()[1].coefficients[1], 1e-13));
    assert!(close(order_0.f.unwrap(), alone.fits()[1].f.unwrap(), 1e-12));
    assert!(close(order_0.linear[0].variance_inflation, 1.0, 1e-14));
}

#[test]
fn the_transient_and_the_order_beside_it_are_found() {
    let (u, lagged) = temperature(6);
    let difference: Vec<_> = lagged.iter().zip(&u).map(|(&lagged, &u)| lagged - u).collect();
    let y = |i: usize| {
        let (u, d) = (u[i].value(), difference[i].value());
        DoubleDouble::from(793.5 - 1074.7 * u + 420.8 * u * u - 53.7 * u.powi(3) + 35.0 * d + 0.5 * scatter(i))
    };
    let order = default_order(&u.iter().map(|u| u.value()).collect::<Vec<_>>(), 1);
    assert_eq!(order, 6);
    let column = column("lagged-u", &difference);
    let table = OrderTable::choose(
        Regression::with_linear(points(&u, y), "u", vec![column.clone()], order).unwrap(),
        &Rule::default(),
    );
    assert_eq!(table.choice.order, 3, "{}", table.choice.reason);
    let transient = &table.regression.fits()[3].linear[0];
    assert!((transient.coefficient - 35.0).abs() < 3.0 * transient.standard_error.unwrap(), "{transient:?}");
    assert!(transient.standard_error.unwrap() < 0.5 && transient.p.unwrap() < 1e-9, "{transient:?}");
    assert!(close(table.regression.fits()[3].residual_sd.unwrap(), 0.5 / 2_f64.sqrt(), 0.1));
    let text = table.text("u", "bias");
    assert!(text.starts_with("bias as a polynomial of u, and linear in lagged-u: 250 points\n"), "{text}");
    assert!(text.contains("\norder 0: ") && text.contains("\n  lagged-u "), "{text}");
    let document = table.json();
    assert_eq!((&document["linear"][0], &document["orders"][3]["order"]), (&"lagged-u".into(), &3.into()));
    assert_eq!(document["orders"][3]["linear"][0]["coefficient"], transient.coefficient);
    // Without it nothing of the polynomial can make up for it.
    let without = Regression::new(points(&u, y), order).unwrap();
    assert!(without.fits().iter().all(|fit| fit.residual_sd.unwrap() > 2.0));
    assert!(OrderTable::choose(without, &Rule::default()).json().get("linear").is_none());
    // Scatter about only the column is a constant and the column.
    let alone = points(&u, |i| difference[i] + DoubleDouble::from(0.01 * scatter(i)));
    let choice = choose(&Regression::with_linear(alone, "u", vec![column], order).unwrap(), &Rule::default());
    assert!(choice.order == 0 && choice.reason.contains(": a constant and the linear columns"), "{}", choice.reason);
}

#[test]
fn leave_one_out_errors_equal_those_of_refits() {
    let (u, lagged) = temperature(4);
    let (u, lagged) = (&u[..12], &lagged[..12]);
    let all = points(u, |i| u[i] * u[i] + lagged[i] + DoubleDouble::from(0.1 * scatter(i)));
    let fit = |points: &[DataPoint], lagged: &[DoubleDouble]| {
        Regression::with_linear(points.to_vec(), "u", vec![column("lagged", lagged)], 1).unwrap()
    };
    let whole = fit(&all, lagged);
    let squares = (0..all.len()).map(|left_out| {
        let (mut points, mut lagged) = (all.clone(), lagged.to_vec());
        let (point, z) = (points.remove(left_out), lagged.remove(left_out));
        let regression = fit(&points, &lagged);
        let rest = &regression.fits()[1];
        let value = rest.coefficients[0] + rest.coefficients[1] * point.x.value();
        (point.y.value() - value - rest.linear[0].coefficient * z.value()).powi(2)
    });
    let rms = (squares.sum::<f64>() / all.len() as f64).sqrt();
    assert!(close(whole.fits()[1].leave_one_out_rms.unwrap(), rms, 1e-9), "{rms}");
    // A point of weight 2 counts as two.
    let (mut twice, mut lagged_twice, mut weighted) = (all.clone(), lagged.to_vec(), all);
    twice.push(twice[3]);
    lagged_twice.push(lagged[3]);
    weighted[3].weight = DoubleDouble::from(2.0);
    let (twice, weighted) = (fit(&twice, &lagged_twice), fit(&weighted, lagged));
    let [a, b] = [&twice.fits()[1].linear[0], &weighted.fits()[1].linear[0]];
    assert!(close(a.coefficient, b.coefficient, 1e-13) && close(a.sum_of_squares, b.sum_of_squares, 1e-13));
    assert!(close(a.variance_inflation, b.variance_inflation, 1e-13));
}

/// The refusal of these columns, with the temperature as x.
fn refusal(u: &[DoubleDouble], columns: &[(&str, Vec<DoubleDouble>)], order: usize) -> RegressionError {
    let linear = columns.iter().map(|(name, values)| column(name, values)).collect();
    Regression::with_linear(points(u, |i| DoubleDouble::from(scatter(i))), "u", linear, order).unwrap_err()
}

fn dependent(error: &RegressionError) -> Vec<&str> {
    match error {
        RegressionError::Dependent { columns, .. } => columns.iter().map(String::as_str).collect(),
        other => panic!("{other}"),
    }
}

#[test]
fn columns_that_say_the_same_are_refused_by_name() {
    // Few decimals, and those of doubles.
    for decimals in [3, 6, 15] {
        let (u, lagged) = temperature(decimals);
        let derive = |of: &dyn Fn(f64, f64) -> f64| -> Vec<DoubleDouble> {
            let both = u.iter().zip(&lagged);
            both.map(|(u, lagged)| number(&format!("{:.decimals$}", of(u.value(), lagged.value())))).collect()
        };
        let exact: Vec<_> = lagged.iter().zip(&u).map(|(&lagged, &u)| lagged - u).collect();
        let other = derive(&|u, _| libm::sin(3.0 * u));
        for (columns, named) in [
            (vec![("same", u.clone())], vec!["same", "u"]),
            (vec![("fahrenheit", derive(&|u, _| 1.8 * u + 32.0))], vec!["fahrenheit", "u"]),
            (vec![("lagged", lagged.clone()), ("lagged-u", exact)], vec!["lagged", "lagged-u", "u"]),
            (vec![("lagged", lagged.clone()), ("d", derive(&|u, l| l - u))], vec!["lagged", "d", "u"]),
            (vec![("other", other.clone()), ("a", lagged.clone()), ("b", derive(&|_, l| -2.0 * l))], vec!["a", "b"]),
        ] {
            let error = refusal(&u, &columns, 3);
            assert_eq!(dependent(&error), named, "{decimals} decimals: {error}");
            assert!(error.to_string().contains("leave one of them out"), "{error}");
        }
        let error = refusal(&u, &[("other", other), ("const", derive(&|_, _| 0.1))], 3);
        assert_eq!(error, RegressionError::Constant("const".to_owned()), "{error}");
    }
}

#[test]
fn a_power_of_x_is_refused_with_the_order_that_is_possible() {
    let (u, _) = temperature(15);
    let square: Vec<_> = u.iter().map(|&u| u * u).collect();
    let error = refusal(&u, &[("square", square.clone())], 4);
    assert_eq!(dependent(&error), ["square", "u^2"]);
    assert!(error.to_string().ends_with("leave one of them out, or fit up to order 1 only"), "{error}");
    let linear = vec![column("square", &square)];
    assert!(Regression::with_linear(points(&u, |i| DoubleDouble::from(scatter(i))), "u", linear, 1).is_ok());
}

#[test]
fn columns_with_a_little_of_their_own_are_fitted_and_warned_of() {
    let (u, _) = temperature(6);
    // Zeros and ones, small whole numbers, and a tenth of a millivolt next to the temperature itself.
    let phase: Vec<_> = (0..u.len()).map(|i| DoubleDouble::from(f64::from(i / 63 % 2 == 0))).collect();
    let position: Vec<_> = (0..u.len()).map(|i| DoubleDouble::from((i % 5) as f64)).collect();
    let beside: Vec<_> =
        u.iter().enumerate().map(|(i, &u)| number(&format!("{:.6}", u.value() + 1e-4 * scatter(i)))).collect();
    let y = |i: usize| phase[i] + position[i] + DoubleDouble::from(10.0 * (scatter(i) - scatter(i + 1000)));
    let linear = vec![column("phase", &phase), column("position", &position), column("beside", &beside)];
    let table = OrderTable::choose(Regression::with_linear(points(&u, y), "u", linear, 2).unwrap(), &Rule::default());
    let warned: Vec<_> = table.diagnostics.warnings.iter().filter(|text| text.contains("variance inflation")).collect();
    let order = table.choice.order;
    assert_eq!(warned.len(), usize::from(order > 0), "{warned:?}");
    let inflation: Vec<_> = table.regression.fits()[1].linear.iter().map(|term| term.variance_inflation).collect();
    assert!(inflation[0] < 2.0 && inflation[1] < 2.0 && inflation[2] > 1e7, "{inflation:?}");
}

#[test]
fn data_that_allow_no_regression_are_refused() {
    let (u, lagged) = temperature(6);
    let few = |count: usize, order: usize, values: usize| {
        let linear = vec![column("lagged", &lagged[..values])];
        Regression::with_linear(points(&u[..count], |i| lagged[i]), "u", linear, order).map(|_| ())
    };
    assert_eq!(few(4, 3, 4), Err(RegressionError::TooFewRows { order: 3, linear: 1, points: 4 }));
    let length = RegressionError::Length { column: "lagged".to_owned(), values: 4, points: 5 };
    assert_eq!(few(5, 2, 4), Err(length));
    assert_eq!(few(3, 3, 3), Err(RegressionError::TooFewPoints { order: 3, distinct: 3 }));
    assert_eq!(default_order(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2), 2);
    // Any scale of the columns is answered or refused, and every figure is finite.
    for exponent in [-135, -60, -12, 12, 60, 135] {
        let scaled: Vec<_> =
            lagged.iter().map(|value| DoubleDouble::from(value.value() * 10_f64.powi(exponent))).collect();
        let regression = Regression::with_linear(points(&u, |i| lagged[i]), "u", vec![column("lagged", &scaled)], 3);
        if let Ok(regression) = regression {
            let term = &regression.fits()[3].linear[0];
            assert!(term.coefficient.is_finite() && term.sum_of_squares.is_finite(), "{exponent}: {term:?}");
        }
    }
}
