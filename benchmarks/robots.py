"""Programs of peers for `codegen.py`: CppADCodeGen's Jacobian by the parameters, and libraries of robots.

Each runs in a Python of its own with the arguments count, q.npy, p.npy, found.npy, instruction set and the folder of Eigen, and
prints the seconds of one pose. pinocchio's regressor, and the Jacobians of pinocchio, Drake and frax by the joints, are of a
chain without errors; the latter have one column a joint, 5 instead of 30: they do less.
"""

CPPADCODEGEN = r"""
import ctypes, subprocess, sys, sysconfig, time, numpy
from pathlib import Path
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n].copy(); p = numpy.load(sys.argv[3])
include = Path(sysconfig.get_paths()['purelib']) / 'cmeel.prefix' / 'include'
assert (include / 'cppad' / 'cg.hpp').exists(), 'no CppADCodeGen'
Path('generate.cc').write_text('''
#include <cppad/cg/cppadcg.hpp>
#include <array>
#include <fstream>
using CG = CppAD::cg::CG<double>; using S = CppAD::AD<CG>;
using V = std::array<S, 3>; using M = std::array<V, 3>;
static M turn(int k, S a) {
    const S c = cos(a), s = sin(a), o(CG(1.0)), z(CG(0.0));
    if (k == 0) return {V{o, z, z}, V{z, c, -s}, V{z, s, c}};
    if (k == 1) return {V{c, z, s}, V{z, o, z}, V{-s, z, c}};
    return {V{c, -s, z}, V{s, c, z}, V{z, z, o}};
}
static M mul(const M &a, const M &b) {
    M r;
    for (int i = 0; i < 3; ++i) for (int j = 0; j < 3; ++j) r[i][j] = a[i][0]*b[0][j] + a[i][1]*b[1][j] + a[i][2]*b[2][j];
    return r;
}
int main() {
    std::vector<S> x(35), y(3);
    for (auto &v : x) v = CG(0.1);
    CppAD::Independent(x);
    const int kind[5][3] = {{1, 1, -1}, {1, 0, -1}, {0, 1, -1}, {0, 2, -1}, {1, 2, 1}};
    M r[5]; V t[5];
    for (int i = 0; i < 5; ++i) {
        const S *e = &x[5 + 6 * i];
        r[i] = mul(mul(turn(0, e[3] * S(CG(1e-6))), turn(1, e[4] * S(CG(1e-6)))), turn(2, e[5] * S(CG(1e-6))));
        for (int j = 0; j < 3; ++j) t[i][j] = e[j] * S(CG(1e-3));
        const S moved = x[i] * S(CG(double(kind[i][2])));
        if (kind[i][0]) t[i][kind[i][1]] += moved; else r[i] = mul(r[i], turn(kind[i][1], moved));
    }
    V d;
    for (int i = 0; i < 3; ++i) d[i] = r[4][i][2] * S(CG(-150.0)) + t[4][i];
    for (int k = 0; k < 4; ++k) {
        V u, w;
        for (int i = 0; i < 3; ++i) u[i] = d[i] - t[k][i];
        for (int i = 0; i < 3; ++i) w[i] = r[k][0][i]*u[0] + r[k][1][i]*u[1] + r[k][2][i]*u[2];
        d = w;
    }
    for (int i = 0; i < 3; ++i) y[i] = d[i];
    CppAD::ADFun<CG> fun(x, y);
    fun.optimize();
    CppAD::cg::CodeHandler<double> handler;
    std::vector<CG> at(35);
    handler.makeVariables(at);
    const std::vector<CG> point = fun.Forward(0, at), whole = fun.Jacobian(at);
    std::vector<CG> out(point);
    for (int k = 5; k < 35; ++k) for (int i = 0; i < 3; ++i) out.push_back(whole[35 * i + k]);
    CppAD::cg::LanguageC<double> language("double");
    CppAD::cg::LangCDefaultVariableNameGenerator<double> names;
    handler.generateCode(std::cout, language, out, names);
    std::ofstream("temporaries.txt") << handler.getTemporaryVariableCount();
}''')
library = include.parent / 'lib'
built = ['g++', '-O1', '-w', '-I', str(include), '-isystem', sys.argv[6], 'generate.cc', '-o', 'generate', '-ldl']
built += ['-L', str(library), '-lcppad_lib', f'-Wl,-rpath,{library}']
subprocess.run(built, check=True)
body = subprocess.run(['./generate'], check=True, capture_output=True, text=True).stdout
count = int(Path('temporaries.txt').read_text())
Path('cppad.c').write_text('''
#include <math.h>
#include <stddef.h>
static void one(const double *x, double *y) { double v[%d];
%s
}
void loop(size_t n, const double *q, const double *p, double *d, double *j) {
    double x[35], y[93];
    for (int k = 0; k < 30; ++k) x[5 + k] = p[k];
    for (size_t i = 0; i < n; ++i) {
        for (int k = 0; k < 5; ++k) x[k] = q[5 * i + k];
        one(x, y);
        for (int k = 0; k < 3; ++k) d[3 * i + k] = y[k];
        for (int k = 0; k < 90; ++k) j[90 * i + k] = y[3 + k];
    }
}''' % (count + 1, body))
march = '-march=' + sys.argv[5]
subprocess.run(['gcc', '-O3', '-w', march, '-shared', '-fPIC', 'cppad.c', '-o', 'cppad.so', '-lm'], check=True)
loop = ctypes.CDLL('./cppad.so').loop; d = numpy.empty((n, 3)); j = numpy.empty((n, 90)); best = 1e9
for _ in range(5):
    s = time.process_time(); loop(ctypes.c_size_t(n), *(ctypes.c_void_p(a.ctypes.data) for a in (q, p, d, j)))
    best = min(best, time.process_time() - s)
numpy.save(sys.argv[4], j[:50].reshape(50, 30, 3).transpose(0, 2, 1)); print(best / n)
"""
PINOCCHIO = """
import sys, time, numpy, pinocchio as pin
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n]
model, parent = pin.Model(), 0
for i, joint in enumerate((pin.JointModelPY(), pin.JointModelPX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPZ())):
    parent = model.addJoint(parent, joint, pin.SE3.Identity(), str(i))
data, best = model.createData(), 1e9
tool = pin.SE3(numpy.eye(3), numpy.array([0.0, 0.0, -150.0]))
for _ in range(3):
    s = time.process_time()
    for row in q:
        pin.forwardKinematics(model, data, row)
        pin.computeJointKinematicRegressor(model, data, 5, pin.ReferenceFrame.LOCAL, tool)
    best = min(best, time.process_time() - s)
print(best / n)
"""
PINOCCHIO_JOINTS = """
import sys, time, numpy, pinocchio as pin
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n]
model, parent = pin.Model(), 0
for i, joint in enumerate((pin.JointModelPY(), pin.JointModelPX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPZ())):
    parent = model.addJoint(parent, joint, pin.SE3.Identity(), str(i))
data, best = model.createData(), 1e9
for _ in range(3):
    s = time.process_time()
    for row in q:
        pin.computeJointJacobian(model, data, row, 5)
    best = min(best, time.process_time() - s)
print(best / n)
"""
DRAKE = """
import sys, time, numpy
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, PrismaticJoint, RevoluteJoint, SpatialInertia
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n]
plant = MultibodyPlant(0.0)
before = plant.world_body()
kinds = (PrismaticJoint, 1), (PrismaticJoint, 0), (RevoluteJoint, 1), (RevoluteJoint, 2), (PrismaticJoint, 2)
for i, (kind, k) in enumerate(kinds):
    body = plant.AddRigidBody(str(i), SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    plant.AddJoint(kind(str(i), before.body_frame(), body.body_frame(), numpy.eye(3)[k]))
    before = body
plant.Finalize()
context = plant.CreateDefaultContext()
frame, world, tool, best = before.body_frame(), plant.world_frame(), numpy.array([0.0, 0.0, -150.0]), 1e9
for _ in range(3):
    s = time.process_time()
    for row in q:
        plant.SetPositions(context, row)
        plant.CalcJacobianTranslationalVelocity(context, JacobianWrtVariable.kQDot, frame, tool, world, world)
    best = min(best, time.process_time() - s)
print(best / n)
"""
FRAX = """
import os, sys, time, warnings
warnings.simplefilter('ignore')
os.environ |= {'JAX_ENABLE_X64': '1', 'XLA_FLAGS': '--xla_cpu_multi_thread_eigen=false'}
import jax, numpy, frax
n = int(sys.argv[1]); q = jax.numpy.asarray(numpy.load(sys.argv[2])[:n])
kinds = ('prismatic', '0 1 0'), ('prismatic', '1 0 0'), ('revolute', '0 1 0'), ('revolute', '0 0 1'), ('prismatic', '0 0 1')
inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
links = ''.join(f'<link name="l{i}">{inertia}</link>' for i in range(6))
joints = ''.join(
    f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="{axis}"/>'
    '<limit lower="-1e3" upper="1e3" effort="1" velocity="1"/></joint>' for i, (kind, axis) in enumerate(kinds))
open('chain.urdf', 'w').write(f'<robot name="chain">{links}{joints}</robot>')
tool = numpy.eye(4); tool[2, 3] = -150.0
robot = frax.Manipulator('chain.urdf', ee_offset=tool)
f = jax.jit(jax.vmap(robot.ee_jacobian))
f(q).block_until_ready(); best = 1e9
for _ in range(5):
    s = time.process_time(); f(q).block_until_ready(); best = min(best, time.process_time() - s)
print(best / n)
"""
