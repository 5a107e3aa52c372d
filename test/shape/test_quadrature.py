"""Panel quadrature against the integrals of polynomials and of a sine."""

import numpy as np

from sesa2.shape.quadrature import PanelQuadrature

ENDS = np.array([0.0, 0.07, 0.3, 0.3125, 1.0])
U = np.array([1.0, 0.0, 0.07, 0.1, 0.31, 0.5, 0.0, 0.999])


def test_polynomials_up_to_the_fourth_degree_are_exact_anywhere():
    panels = PanelQuadrature(ENDS)
    for k in range(5):
        np.testing.assert_allclose(
            panels.integrals(U) @ panels.nodes**k, U ** (k + 1) / (k + 1), rtol=0.0, atol=1e-15
        )


def test_up_to_the_last_place_the_ninth_degree_is_exact():
    panels = PanelQuadrature(ENDS)
    ends = panels.integrals(ENDS)
    np.testing.assert_allclose(ends @ panels.nodes**9, ENDS**10 / 10, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(ends @ np.cos(4 * panels.nodes), np.sin(4 * ENDS) / 4, rtol=0.0, atol=1e-13)


def test_a_function_may_have_kinks_at_the_ends_of_sections():
    panels = PanelQuadrature(ENDS)
    kinked = np.abs(panels.nodes - 0.3)
    integral = np.where(U < 0.3, 0.3 * U - U**2 / 2, 0.09 - 0.3 * U + U**2 / 2)
    np.testing.assert_allclose(panels.integrals(U) @ kinked, integral, rtol=0.0, atol=1e-15)
