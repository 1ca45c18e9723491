"""Whitening of linearised rows by the inverse Cholesky root of their joint covariance."""

from palpate.arrays import Array, Records
from palpate.compiled import kernel


@kernel
def whiten(count: int, root: Array, out: Records) -> None:
    """Multiply residuals and Jacobian of the first rows by a lower triangular root (count, count)."""
    for r in range(count - 1, -1, -1):  # a row depends on those before it, which are still unchanged
        row = out.jacobian[r]
        residual = root[r, r] * out.residual[r]
        for c in range(len(row)):
            row[c] *= root[r, r]
        for k in range(r):
            residual += root[r, k] * out.residual[k]
            for c in range(len(row)):
                row[c] += root[r, k] * out.jacobian[k, c]
        out.residual[r] = residual
        out.information[r] = 1.0
        out.weight[r] = 1.0
