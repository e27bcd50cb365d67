"""A periodic cell of stockinette, relaxed at rest and stretched by 20 % along the course and along the wale.

Every equilibrium comes with its energy density, the exact derivatives by the macroscopic strain, and the closest
approach of two yarns: the contact is soft and lets them press into each other a little.
"""

import yarnscale as ys

wool = ys.YarnMaterial.preset("hylc2020-stockinette")
fabric = ys.settled(ys.patterns.build("stockinette"), wool).pattern
cell = ys.PeriodicCell(fabric, wool)
print(f"{len(fabric.edges)} vertices, period {1e3 * fabric.period} mm, {1e3 * cell.area_density:.0f} g/m²")

rest = cell.relax()
course = cell.relax(ys.ShellStrain(s_x=0.2))
wale = cell.relax(ys.ShellStrain(s_y=0.2), start=rest)
for name, state in {"rest": rest, "course": course, "wale": wale}.items():
    print(f"{name:<7} {state.status.name.lower()}, {state.energy_density:.4f} J/m², {state.contacts} contacts")
    assert state.converged

# At rest in the plane; 20 % cost 1.07 J/m² along the course, less along the wale.
assert abs(rest.stress[0]) < 1e-3 * course.stress[0] and abs(rest.stress[2]) < 1e-3 * wale.stress[2]
assert abs(course.energy_density - 1.07) < 0.02
assert rest.energy_density < wale.energy_density < course.energy_density
