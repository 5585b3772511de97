"""Makes tails.csv: tails of distributions and the values that are exceeded with a given probability, to 17 digits.

Needs mpmath, which has them to as many digits as one asks for: here 34, and none that the arguments, which are doubles, take away.
"""
import mpmath as mp

mp.mp.dps = 34


def f_tail(f, d1, d2):
    f, d1, d2 = mp.mpf(f), mp.mpf(d1), mp.mpf(d2)
    return below(d2 / 2, d1 / 2, d2 / (d2 + d1 * f))


def beta_tail(x, a, b):
    return below(mp.mpf(b), mp.mpf(a), 1 - mp.mpf(x))


def below(a, b, x):
    """The incomplete beta function by its series with positive terms (DLMF 8.17.8); for x near 1, that of its complement."""
    if x > (a + 1) / (a + b + 2):
        return 1 - below(b, a, 1 - x)
    total = term = mp.mpf(1)
    n = 0
    while term > total * mp.mpf(10) ** -33:
        term *= x * (a + b + n) / (a + 1 + n)
        total += term
        n += 1
    return total * mp.exp(a * mp.log(x) + b * mp.log(1 - x) - mp.loggamma(a) - mp.loggamma(b) + mp.loggamma(a + b)) / a


def chi_square_tail(value, freedom):
    """By the series of the lower gamma function (DLMF 8.11.4)."""
    a, x = mp.mpf(freedom) / 2, mp.mpf(value) / 2
    total = term = mp.mpf(1)
    n = 0
    while term > total * mp.mpf(10) ** -33:
        n += 1
        term *= x / (a + n)
        total += term
    return 1 - total * mp.exp(a * mp.log(x) - x - mp.loggamma(a + 1))


def limit(p, tail):
    """Bisection of a bracket."""
    low = high = mp.mpf(1)
    while tail(low) < p:
        low /= 1.5
    while tail(high) > p:
        high *= 1.5
    for _ in range(64):
        middle = (low + high) / 2
        if tail(middle) > p:
            low = middle
        else:
            high = middle
    return high


with open("tails.csv", "w") as file:
    def write(name, arguments, value):
        file.write(",".join([name, *map(repr, arguments), mp.nstr(value, 17)]) + "\n")

    for d1 in (1.0, 2.0, 3.5, 7.0, 40.0, 300.0):
        for d2 in (1.0, 2.5, 5.0, 11.0, 100.0, 1234.5, 9000.0):
            for f in (1e-6, 0.1, 0.9, 1.1, 2.0, 5.0, 30.0, 500.0):
                value = f_tail(f, d1, d2)
                if value > mp.mpf(10) ** -280:
                    write("f_tail", (f, d1, d2), value)
    for a in (0.5, 1.0, 4.25, 60.0, 3000.0):
        for b in (0.5, 2.0, 33.3, 800.0):
            for x in (1e-5, 0.03, 0.4, 0.75, 0.99):
                value = beta_tail(x, a, b)
                if value > mp.mpf(10) ** -280:
                    write("beta_tail", (x, a, b), value)
    for p in (1e-9, 0.05):
        for d1 in (1.0, 7.0):
            for d2 in (1.0, 12.5):
                write("f_limit", (p, d1, d2), limit(mp.mpf(p), lambda f: f_tail(f, d1, d2)))
    for p in (1e-6, 0.025, 0.5, 0.975):
        for freedom in (0.7, 1.0, 2.0, 5.3, 31.0, 250.5, 4000.0):
            write("chi_square_limit", (p, freedom), limit(mp.mpf(p), lambda value: chi_square_tail(value, freedom)))
