/* Energy density of a shell material{{ title }}, written by yarnscale.

   strain: s_x = sqrt(I11) - 1, s_a = I12/sqrt(I11 I22), s_y = sqrt(I22) - 1, II11, II12, II22 [1/m].
   energy [J/m^2] per rest area; gradient and hessian (row by row) are its derivatives by the strain.
   Any of the three outputs may be null. Returns 0, or 1 for a strain that no surface has
   (s_x <= -1, s_y <= -1, |s_a| >= 1 or not a number), and then writes nothing.
   Thread-safe: no state is kept. Compile as C99 or later, without -ffast-math; link with -lm.

   density: {{ density }} kg/m^2.
*/

#include <math.h>

enum { STEPS = {{ springs.steps|length }}, SPRINGS = {{ springs.springs|length }}, WALLS = {{ springs.walls|length }} };

{% for name, values in arrays.items() %}
static const double {{ name }}[{{ [values.size, 1]|max }}] = {
  {{ values|rows|join(",\n  ") or "0" }}};

{% endfor %}
int yarnscale_energy(const double strain[6], double *energy, double gradient[6], double hessian[36]) {
  double psi = {{ constant }}, first[6] = {0}, second[36] = {0};
  if (!(strain[0] > -1.0 && strain[2] > -1.0 && fabs(strain[1]) < 1.0)) return 1;
  for (int i = 0; i < 6; ++i) if (!isfinite(strain[i])) return 1;
  for (int m = 0; m < {{ images|length }}; ++m) {
    double x[6], bent[STEPS + 1], bent1[STEPS + 1], bent2[STEPS + 1], through[STEPS + 1] = {0};
    const double *sign = images + 6 * m, share = 1.0 / {{ images|length }};
    for (int i = 0; i < 6; ++i) x[i] = sign[i] * strain[i] * inverse_scale[i];
    for (int i = 0; i < 6; ++i) {
      psi += share * 0.5 * background[i] * x[i] * x[i];
      first[i] += share * sign[i] * background[i] * x[i];
      second[7 * i] += share * background[i];
    }
    for (int j = 0; j < STEPS; ++j) {
      double a = step_offsets[j];
      for (int i = 0; i < 6; ++i) a += steps[6 * j + i] * x[i];
      const double inverse = 1.0 / sqrt(1.0 + a * a);
      bent[j] = a * inverse;
      bent1[j] = inverse * inverse * inverse;
      bent2[j] = -3.0 * a * bent1[j] * inverse * inverse;
    }
    for (int k = 0; k < SPRINGS; ++k) {
      double u = spring_offsets[k], slope[6];
      for (int i = 0; i < 6; ++i) { slope[i] = springs[6 * k + i]; u += slope[i] * x[i]; }
      for (int j = 0; j < STEPS; ++j) {
        const double w = bends[STEPS * k + j];
        u += w * bent[j];
        for (int i = 0; i < 6; ++i) slope[i] += w * bent1[j] * steps[6 * j + i];
      }
      const double inverse = 1.0 / sqrt(1.0 + u * u), r = 0.5 * (u + 1.0 / inverse), part = 1.0 / (1.0 + r);
      const double s = r * part, r1 = r * inverse, by_r = s * s * (3.0 * part + s), tau = r * s * s, tau1 = by_r * r1;
      const double tau2 = 6.0 * s * part * part * part * r1 * r1 + 0.5 * by_r * inverse * inverse * inverse;
      const double e = share * stiffnesses[k], e1 = 2.0 * e * tau * tau1, e2 = 2.0 * e * (tau1 * tau1 + tau * tau2);
      psi += e * tau * tau;
      for (int j = 0; j < STEPS; ++j) through[j] += bends[STEPS * k + j] * e1 * bent2[j];
      for (int i = 0; i < 6; ++i) {
        first[i] += sign[i] * e1 * slope[i];
        for (int l = 0; l < 6; ++l) second[6 * i + l] += sign[i] * sign[l] * e2 * slope[i] * slope[l];
      }
    }
    for (int j = 0; j < STEPS; ++j)
      for (int i = 0; i < 6; ++i)
        for (int l = 0; l < 6; ++l)
          second[6 * i + l] += sign[i] * sign[l] * through[j] * steps[6 * j + i] * steps[6 * j + l];
    for (int k = 0; k < WALLS; ++k) {
      const double *h = walls + 6 * k, f = share * wall_stiffnesses[k];
      double u = -wall_offsets[k];
      for (int i = 0; i < 6; ++i) u += h[i] * x[i];
      if (u <= 0.0) continue;
      psi += f * u * u * u;
      for (int i = 0; i < 6; ++i) {
        first[i] += sign[i] * 3.0 * f * u * u * h[i];
        for (int l = 0; l < 6; ++l) second[6 * i + l] += sign[i] * sign[l] * 6.0 * f * u * h[i] * h[l];
      }
    }
  }
  if (energy) *energy = psi;
  if (gradient) for (int i = 0; i < 6; ++i) gradient[i] = first[i] * inverse_scale[i];
  if (hessian)
    for (int i = 0; i < 6; ++i)
      for (int l = 0; l < 6; ++l) hessian[6 * i + l] = second[6 * i + l] * inverse_scale[i] * inverse_scale[l];
  return 0;
}
