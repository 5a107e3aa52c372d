"""The arm as a simulated Cosserat rod: trials whose truth is known, recorded by simulated BNO055s."""
