"""Makes Filip.json, Wampler3.json and Wampler5.json: the sets' decimals and the regression in exact arithmetic.

Data: NIST StRD, linear least squares (public domain). Certified values have 15 digits; these have 30, from exact rational
arithmetic on the decimals and 80-digit square roots. Wampler3 and 5 are Wampler4 with its errors divided and multiplied by 100.
"""
import json
from decimal import Decimal, getcontext
from fractions import Fraction

getcontext().prec = 80

FILIP = """
0.8116 -6.860120914 0.9072 -4.324130045 0.9052 -4.358625055 0.9039 -4.358426747 0.8053 -6.955852379 0.8377 -6.661145254
0.8667 -6.355462942 0.8809 -6.118102026 0.7975 -7.115148017 0.8162 -6.815308569 0.8515 -6.519993057 0.8766 -6.204119983
0.8885 -5.853871964 0.8859 -6.109523091 0.8959 -5.79832982 0.8913 -5.482672118 0.8959 -5.171791386 0.8971 -4.851705903
0.9021 -4.517126416 0.909 -4.143573228 0.9139 -3.709075441 0.9199 -3.499489089 0.8692 -6.300769497 0.8872 -5.953504836
0.89 -5.642065153 0.891 -5.031376979 0.8977 -4.680685696 0.9035 -4.329846955 0.9078 -3.928486195 0.7675 -8.56735134
0.7705 -8.363211311 0.7713 -8.107682739 0.7736 -7.823908741 0.7775 -7.522878745 0.7841 -7.218819279 0.7971 -6.920818754
0.8329 -6.628932138 0.8641 -6.323946875 0.8804 -5.991399828 0.7668 -8.781464495 0.7633 -8.663140179 0.7678 -8.473531488
0.7697 -8.247337057 0.77 -7.971428747 0.7749 -7.676129393 0.7796 -7.352812702 0.7897 -7.072065318 0.8131 -6.774174009
0.8498 -6.478861916 0.8741 -6.159517513 0.8061 -6.835647144 0.846 -6.53165267 0.8751 -6.224098421 0.8856 -5.910094889
0.8919 -5.598599459 0.8934 -5.290645224 0.894 -4.974284616 0.8957 -4.64454848 0.9047 -4.290560426 0.9129 -3.885055584
0.9209 -3.408378962 0.9219 -3.13200249 0.7739 -8.726767166 0.7681 -8.66695597 0.7665 -8.511026475 0.7703 -8.165388579
0.7702 -7.886056648 0.7761 -7.588043762 0.7809 -7.283412422 0.7961 -6.995678626 0.8253 -6.691862621 0.8602 -6.392544977
0.8809 -6.067374056 0.8301 -6.684029655 0.8664 -6.378719832 0.8834 -6.065855188 0.8898 -5.752272167 0.8964 -5.132414673
0.8963 -4.811352704 0.9074 -4.098269308 0.9119 -3.66174277 0.9228 -3.2644011
""".split()


def solve(matrix, right):
    n = len(matrix)
    rows = [list(matrix[i]) + list(right[i]) for i in range(n)]
    for i in range(n):
        pivot = next(k for k in range(i, n) if rows[k][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [v / rows[i][i] for v in rows[i]]
        for k in range(n):
            if k != i and rows[k][i] != 0:
                rows[k] = [a - rows[k][i] * b for a, b in zip(rows[k], rows[i])]
    return [row[n:] for row in rows]


def decimal(fraction):
    return Decimal(fraction.numerator) / Decimal(fraction.denominator)


def text(number):
    return f"{number:.29e}"


def regress(x, y, degree):
    xs, ys = [Fraction(v) for v in x], [Fraction(v) for v in y]
    n, m = len(xs), degree
    moments = [sum(v**k for v in xs) for k in range(2 * m + 1)]
    normal = [[moments[i + j] for j in range(m + 1)] for i in range(m + 1)]
    unit = [[Fraction(int(i == j)) for j in range(m + 1)] for i in range(m + 1)]
    inverse = solve(normal, unit)
    right = [sum(v * u**k for u, v in zip(xs, ys)) for k in range(m + 1)]
    b = [sum(c * r for c, r in zip(row, right)) for row in inverse]
    sse = sum((v - sum(c * u**k for k, c in enumerate(b))) ** 2 for u, v in zip(xs, ys))
    mean = sum(ys) / n
    sst = sum((v - mean) ** 2 for v in ys)
    ms = sse / (n - m - 1)
    return {
        "digits": 30,
        "coefficients": [text(decimal(c)) for c in b],
        "sd": [text(decimal(ms * inverse[k][k]).sqrt()) for k in range(m + 1)],
        "residual_sd": text(decimal(ms).sqrt()),
        "r_squared": text(decimal(1 - sse / sst)),
        "f": text(decimal((sst - sse) / m / ms)),
        "ss_regression": text(decimal(sst - sse)),
        "ss_residual": text(decimal(sse)),
    }


def write(name, x, y, degree):
    data = {"name": name, "n": len(x), "degree": degree, "text": {"x": x, "y": y}, "exact_recomputed": regress(x, y, degree)}
    with open(f"{name}.json", "w") as file:
        json.dump(data, file, indent=1)
        file.write("\n")


write("Filip", FILIP[1::2], FILIP[0::2], 10)
wampler4 = json.load(open("Wampler4.json"))["text"]
exact = [sum(int(x) ** k for k in range(6)) for x in wampler4["x"]]
for name, factor in (("Wampler3", Fraction(1, 100)), ("Wampler5", Fraction(100))):
    y = [p + (int(v) - p) * factor for p, v in zip(exact, wampler4["y"])]
    assert all(v.denominator == 1 for v in y)
    write(name, wampler4["x"], [str(v) for v in y], 5)
