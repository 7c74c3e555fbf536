/** Projections of a centre of mass and its covariance on the three coordinate planes. */

/** Axes (horizontal, vertical) of the views along x, y and z. */
export const VIEW_AXES = [
  [1, 2],
  [0, 2],
  [0, 1],
];
export const AXIS_NAMES = ["x", "y", "z"];

/** 95 % quantile of chi squared with two degrees of freedom. */
const CHI2_95 = 5.991465;
/** Standard deviation [m] along a direction in which the centre of mass is not known: beyond every plot. */
const OPEN_SD = 10.0;

/**
 * Covariance [m^2] of the centre of mass with a great variance along directions that are not known.
 *
 * `open` holds unit vectors (x, y, z).
 */
export function widened(covariance, open) {
  const rows = covariance.map((row) => [...row]);
  for (const direction of open ?? [])
    for (let i = 0; i < 3; i += 1)
      for (let j = 0; j < 3; j += 1) rows[i][j] += OPEN_SD ** 2 * direction[i] * direction[j];
  return rows;
}

/**
 * 95 % ellipse of the covariance in the plane of two axes.
 *
 * Returns half axes [m], long one first, and the angle [rad] of the long one from the horizontal axis.
 */
export function ellipse95(covariance, [h, v]) {
  const [a, b, d] = [covariance[h][h], covariance[h][v], covariance[v][v]];
  const mean = (a + d) / 2;
  const radius = Math.hypot((a - d) / 2, b);
  return {
    long_m: Math.sqrt(CHI2_95 * Math.max(mean + radius, 0)),
    short_m: Math.sqrt(CHI2_95 * Math.max(mean - radius, 0)),
    angle: 0.5 * Math.atan2(2 * b, a - d),
  };
}

/** Names of the axes with a large share in a direction that is not known, "z" or "x and y". */
export function openAxes(open) {
  const named = AXIS_NAMES.filter((_, axis) => (open ?? []).some((each) => Math.abs(each[axis]) > 0.4));
  return named.join(" and ");
}
