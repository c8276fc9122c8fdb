"""Displacements of a pressed block by an independent finite element code, for tests/truth/efg_block.rs.

    python3 -m venv venv
    venv/bin/pip install scikit-fem==12.0.2 scipy==1.17.1
    venv/bin/python tests/truth/reference/block.py > tests/truth/reference/block.csv

A block of 60 x 50 x 40 mm, E = 10 kPa, stands on z = 0, where it is held. Half of its top, x < 30 mm, carries a traction of
(15, 10, -50) Pa. Linear elasticity, hexahedra with 27 nodes, 12 x 10 x 8 of them.
"""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementHex2, ElementVector, FacetBasis, LinearForm, MeshHex, condense
from skfem.helpers import ddot, sym_grad, trace

SIZE = np.array([0.06, 0.05, 0.04])
CELLS = [12, 10, 8]
YOUNG = 1e4
TRACTION = [15.0, 10.0, -50.0]

axes = [np.linspace(0.0, length, n + 1) for length, n in zip(SIZE, CELLS)]
mesh = MeshHex.init_tensor(*axes)
element = ElementVector(ElementHex2())
basis = Basis(mesh, element, intorder=4)
tol = 1e-9
base = mesh.facets_satisfying(lambda x: x[2] < tol, boundaries_only=True)
loaded = mesh.facets_satisfying(lambda x: (x[2] > SIZE[2] - tol) & (x[0] < 0.03), boundaries_only=True)


@LinearForm
def push(v, w):
    return sum(t * v[axis] for axis, t in enumerate(TRACTION))


force = push.assemble(FacetBasis(mesh, element, facets=loaded, intorder=4))
held = basis.get_dofs(base)

print("poisson,x_m,y_m,z_m,ux_m,uy_m,uz_m")
for poisson in [0.3, 0.45, 0.49]:
    mu = YOUNG / (2.0 * (1.0 + poisson))
    lam = YOUNG * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))

    @BilinearForm
    def stiffness(u, v, w):
        strain = sym_grad(u)
        return 2.0 * mu * ddot(strain, sym_grad(v)) + lam * trace(strain) * trace(sym_grad(v))

    matrix, right, solution, free = condense(stiffness.assemble(basis), force, D=held)
    solution[free] = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A").solve(right)
    for k in [2, 4]:
        for j in range(6):
            for i in range(7):
                point = np.array([i, j, k]) * 0.01
                # Vertices carry their own displacement.
                vertex = int(np.argmin(np.linalg.norm(mesh.p - point[:, None], axis=0)))
                u = solution[basis.nodal_dofs[:, vertex]]
                print(",".join([f"{poisson}"] + [f"{x:.3f}" for x in point] + [f"{x:.6e}" for x in u]))
