"""From a drawing to a fabric at rest: what the coarse stress of a stockinette says before and after.

A drawn pattern is only a start: held at its periods, its cell is under stress and wants to change size. Letting the
periods follow (HYLC20 §5.1) takes the in-plane stress away; what is left bends the fabric, and it curls.
"""

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import rest_stress_ratio, settled
from yarnscale.drawing import library
from yarnscale.yarn.material import YarnMaterial

wool = YarnMaterial.preset("wool")
drawn = library.build("stockinette")

before = rest_stress_ratio(PeriodicCell(drawn, wool))
shape = settled(drawn, wool, progress=lambda r: print(f"  periods × {r.stretch[0]:.3f}, {r.stretch[1]:.3f}"))
after = shape.stress

print(f"{shape.status.value}; {shape.seconds:.2f} s")
print(f"stress at rest over stress at 5 %: {before.largest:.2%} as drawn, {after.largest:.2%} settled")
print(f"bending stress (curl): {after.at_rest[3]:+.2e}, {after.at_rest[5]:+.2e} J/m")

assert before.largest > 0.1 and after.largest < 0.01
assert after.at_rest[3] > 0.0 > after.at_rest[5]  # curls about both axes, to opposite sides
